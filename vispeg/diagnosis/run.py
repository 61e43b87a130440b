"""`diagnose`: from recordings to a verdict, a model with what was missing, and the evidence for both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.intervals import widened
from vispeg.diagnosis.judge import Judge
from vispeg.diagnosis.localise import maps, missing_torque, peaks, where_it_fails
from vispeg.diagnosis.motionless import refuse_motionless
from vispeg.diagnosis.next_experiment import next_experiment
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.remainder import dependences
from vispeg.diagnosis.rivals import Rivals, find_rivals
from vispeg.diagnosis.search import Search
from vispeg.diagnosis.share import Share
from vispeg.diagnosis.state import State, Trial
from vispeg.diagnosis.subsets import subsets
from vispeg.diagnosis.verdict import Verdict, decide
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import evidence_for
from vispeg.identify.stirred import stirred
from vispeg.recordings.quality import quantization
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import records
from vispeg.worlds.model_file import placed_dict
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Diagnosis:
    """What `vispeg diagnose` found: the record, the model, and the arrays behind the pictures."""

    record: dict[str, Any]
    world: World
    arrays: dict[str, np.ndarray]


def diagnose(
    world: World,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    *,
    seed: int = 0,
    nthread: int = 2,
    say: Callable[[str], None] = lambda _: None,
    plan_next: bool = True,
    progress: Progress | None = None,
) -> Diagnosis:
    """Finds the effects that `world` lacks; every error in the record is on `held_out`.

    `progress` keeps what is worked out, so that a diagnosis with the same arguments can go on after it was killed.

    Raises:
        UserError: recordings that cannot be compared with the world, or in which nothing moves.
    """
    still = refuse_motionless(fitted, held_out)
    evidence, judged = evidence_for(world, fitted, nthread), evidence_for(world, held_out, nthread, h_max=1e-3)
    judge = Judge(judged)
    say = Share(say, ahead=3)  # of one effect: its fit, its rivals, the next experiment
    search = Search(evidence, judge, say, progress)
    given = len(world.effects)
    before_fit = evidence.residuals([world])[0]
    before_held = judged.residuals([world])[0]
    state = search.run(world)
    say.ahead = 1
    rivals = find_rivals(search, state, given, say) if len(state.world.effects) > given else []
    after_held = judged.residuals([state.world])[0]
    before, after = judge.mean(judge.loss(before_held)), judge.mean(state.loss)
    before_missing, after_missing = search.missing(world), search.missing(state.world)
    predicted = judged.simulated([world, state.world])
    held = [[missing_torque(i, y[w]) for i, y in zip(judged.items, predicted, strict=True)] for w in (0, 1)]
    joints = judged.items[0].robot.joints
    depends = dependences(after_missing, held[1], joints)
    fed_back = stirred(judged, state.world) if judged.unit == "rad" else 0.0
    floor = judge.floor(state.world) + fed_back
    verdict = decide(before, after, len(state.world.effects) - given, rivals, depends, floor)
    final = _with_origin(
        widened(state.world, given, before, after - floor + 1.0),
        given,
        fitted,
        held_out,
        judged.angle_rms(before_held),
        judged.angle_rms(after_held),
        verdict.partial,
    )
    equals = [(f"{t.score.placed.label} in place of {r.label}", t.fit.world) for r in rivals for t in r.equals]
    arrays = _arrays(judged, predicted) | subsets(judged, state.world, given, equals)
    drawn, left = maps(judged, held[0]), maps(judged, held[1])
    for axis, (edges, grid) in drawn.items():
        arrays[f"map/{axis}/edges"], arrays[f"map/{axis}/before"] = edges, grid
        arrays[f"map/{axis}/after"] = left[axis][1]
    upcoming, more = (None, {})
    if plan_next:
        say.ahead = 0
        say("choosing what to record next")
        upcoming, more = next_experiment(search, state, rivals, verdict.verdict, seed)
    record = {
        "format": "vispeg-diagnosis/1",
        "verdict": verdict.verdict,
        "reason": verdict.reason,
        "effects": _effects(final, given, rivals),
        "ladder": _ladder(evidence, judged, state, before_fit, before_held),
        "noise_floor": {
            "value": judged.floor,
            "unit": f"{judged.unit} RMS",
            "from": judged.floor_from if judged.floor_from != "estimated" else evidence.floor_from,
        },
        "where_it_fails": where_it_fails(before_missing, joints),
        "residual_peaks": peaks(drawn, joints, left),
        "unexplained": verdict.unexplained,
        "next_experiment": upcoming,
        "candidates": _candidates(state, rivals, given),
        "recordings": {"fit": [r.name for r in fitted], "validate": [r.name for r in held_out]},
        "screening": [{"effect": s.key[0], "where": s.key[1], "score": round(s.gain, 2)} for s in _screening(state)],
        "correlations": _correlations(state),
        "parameters_moved": _moved(state),
        "windows": records([*fitted, *held_out]),
        "notes": [
            *still,
            *evidence.notes,
            *(note for note in judged.notes if note not in evidence.notes),
            *_coarse_encoders(fitted[0], judged),
            *_stirred(fed_back),
        ],
    }
    return Diagnosis(record, final, arrays | more)


def _stirred(fed_back: float) -> list[str]:
    if fed_back < 0.05:
        return []
    text = f"noise fed back by the controller moves the arm by {np.sqrt(fed_back):.2g} times the encoders' noise"
    return [text + ": the right model too is that far off"]


def _screening(state: State):
    first = state.steps[0][1] if state.steps else []
    return [t.score for t in first] + state.screening[:20]


def _with_origin(world, given, fitted, held_out, before, after, partial) -> World:
    origin = {
        "fitted_on": [r.name for r in fitted],
        "validated_on": [r.name for r in held_out],
        "heldout_error_before": float(before),
        "heldout_error_after": float(after),
    }
    found = (replace(e, origin=origin, partial=partial) for e in world.effects[given:])
    effects = world.effects[:given] + tuple(found)
    return replace(world, effects=effects)


def _effects(world: World, given: int, rivals: Sequence[Rivals]) -> list[dict[str, Any]]:
    by_label = {r.label: r for r in rivals}
    out = []
    for e in world.effects[given:]:
        entry = {k: v for k, v in placed_dict(e).items() if k != "origin"}
        equals = by_label[e.label].equals if e.label in by_label else ()
        entry["indistinguishable_from"] = [{"effect": t.score.key[0], "where": t.score.key[1]} for t in equals]
        out.append(entry)
    return out


def _ladder(evidence: Evidence, judged: Evidence, state: State, fit0, held0) -> list[dict[str, Any]]:
    unit = f"{judged.unit} RMS"
    rungs = [
        {
            "model": "nominal",
            "fit_error": evidence.angle_rms(fit0),
            "heldout_error": judged.angle_rms(held0),
            "unit": unit,
        }
    ]
    worlds = [best.fit.world for best, _ in state.steps]
    if state.steps and state.world.label != worlds[-1].label:
        worlds.append(state.world)
    labels = []
    for best, _ in state.steps:
        labels.append(f"+ {best.score.label}")
    if len(worlds) > len(labels):
        labels.append("after backward deletion")
    if worlds:
        fits, helds = evidence.residuals(worlds), judged.residuals(worlds)
        for label, f, h in zip(labels, fits, helds, strict=True):
            rungs.append(
                {"model": label, "fit_error": evidence.angle_rms(f), "heldout_error": judged.angle_rms(h), "unit": unit}
            )
    return rungs


def _candidates(state: State, rivals: Sequence[Rivals], given: int) -> list[dict[str, Any]]:
    out = []
    for best, trials in state.steps:
        for t in trials:
            if t is best:
                continue
            why = t.rejected or f"{best.score.label} explains the held-out data as well or better"
            out.append(_candidate(t, why, given))
    out += [_candidate(t, t.rejected, given) for t in state.last]
    seen = {(c["effect"], c["where"]) for c in out}
    for r in rivals:
        out += [
            _candidate(
                t,
                t.rejected or ("indistinguishable from" if t in r.equals else "explains less than") + f" {r.label}",
                given,
            )
            for t in r.tried
            if t.score.key not in seen
        ]
    return out


def _candidate(t: Trial, why: str, given: int) -> dict[str, Any]:
    beside = [e for e in t.fit.world.effects[given:] if not t.score.has(e)]
    return {
        "effect": t.score.key[0],
        "where": t.score.key[1],
        "tried_beside": [{"effect": e.effect, "where": e.where} for e in beside],
        "heldout_gain": round(t.gain.relative, 5),
        "gain_standard_errors": round(t.gain.z, 2),
        "rejected_because": why,
    }


def _coarse_encoders(rec: Recording, judged: Evidence) -> list[str]:
    """Joints read in steps wider than the noise: squared errors do not show steps of up to some ten times the noise."""
    steps = {joint: quantization(rec.q[:, j]) for j, joint in enumerate(rec.joints)}
    sigma = judged.items[0].recording.noise.get("q", 0.0)
    return [f"{joint} is read in steps of {step:.2g} rad" for joint, step in steps.items() if step and step > 2 * sigma]


def _correlations(state: State) -> dict[str, Any] | None:
    if state.fit is None:
        return None
    labels = [f"{state.world.effects[a.index].label}.{a.name}" for a in state.fit.space.axes]
    return {"labels": labels, "matrix": np.round(state.fit.correlation, 3).tolist()}


def _moved(state: State) -> list[dict[str, Any]]:
    """Parameters of earlier effects that changed by over a tenth of a typical size when a later one was added."""
    out = []
    worlds = [best.fit.world for best, _ in state.steps]
    for before, after in zip(worlds, worlds[1:], strict=False):
        now: dict[tuple[str, str], EffectInstance] = {(e.effect, e.where): e for e in after.effects}
        for e in before.effects:
            later = now.get((e.effect, e.where))
            if later is None:
                continue
            for name, v in e.params.items():
                p = effect(e.effect).params[name]
                if not p.shape and abs(later.params[name].value - v.value) > 0.1 * abs(p.start - p.null):
                    out.append(
                        {"effect": e.effect, "where": e.where, "param": name, "before": v.value,
                         "after": later.params[name].value}
                    )  # fmt: skip
    return out


def _arrays(evidence: Evidence, predicted: list[np.ndarray]) -> dict[str, np.ndarray]:
    out: dict[str, np.ndarray] = {
        "joints": np.array(evidence.items[0].robot.joints),
        "unit": np.array(evidence.unit),
    }
    for r, (item, y) in enumerate(zip(evidence.items, predicted, strict=True)):
        nj = item.nj
        out |= {
            f"{r}/time": item.segment.time,
            f"{r}/name": np.array(item.name),
            f"{r}/measured": item.measured[:, :nj],
            f"{r}/before": y[0][:, :nj],
            f"{r}/after": y[1][:, :nj],
        }
        if item.beside == "torque":
            out |= {
                f"{r}/measured_tau": item.measured[:, nj:],
                f"{r}/before_tau": y[0][:, nj:],
                f"{r}/after_tau": y[1][:, nj:],
            }
    return out


__all__ = ["Diagnosis", "Verdict", "diagnose"]
