"""Which contact effects a free object's model lacks: forward selection on short windows, judged on other tosses."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy import stats

from vispeg.core.effect import REGISTRY, EffectInstance, effect
from vispeg.core.params import Param, Value
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.least_sizes import Trace, least_alone
from vispeg.diagnosis.conclusion.verdict import decide
from vispeg.diagnosis.findings import Gain
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.record import with_origin
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.scale import floors
from vispeg.diagnosis.schema import Candidate, DiagnosisRecord, FoundEffect, NextMotion, Rung, ShowsFrom
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.loop import Loop
from vispeg.diagnosis.window_profile import Profile, profile, sizes
from vispeg.effects.contact.restitution import rebound
from vispeg.identify.restarts import Restarts
from vispeg.identify.surface import line_searches, with_intervals
from vispeg.recordings.objects import ObjectRecording
from vispeg.robots.objects import ObjectModel
from vispeg.worlds.model_file import model_text, without_origin
from vispeg.worlds.world import World

WINDOWS = {"41 ms": 0.041, "162 ms": 0.162, "whole tosses": None}  # s
TOSS = "Let the object go by hand, 20 times or more, each time turned otherwise, and record its pose, a toss an episode"
WEIGH = "Weigh the object five times (`vispeg measure mass`), and write its mass into the model"
# What an effect needs (`Effect.needs`) that no toss has. A soft contact may follow blows better, whose law is not the
# simulator's, and sink at rest by what no pose shows.
NO_TOSS_HAS = {"two forces": "at rest its own weight alone presses on it"}


@dataclass(frozen=True)
class Tried:
    """A fitted candidate with its held-out gain, and the reason of refusal, "" if accepted."""

    world: World
    placed: EffectInstance
    loss: np.ndarray
    gain: Gain
    rejected: str = ""


@dataclass
class Tossed:
    """State of the search: world and loss, accepted effects with the candidates of their steps, refused candidates."""

    world: World
    loss: np.ndarray
    steps: list[tuple[Tried, list[Tried]]] = field(default_factory=list)
    last: list[Tried] = field(default_factory=list)


class ObjectSearch(Loop[Tossed, Tried]):
    """The discovery loop on windows of tosses.

    Args:
        evidence: to fit.
        judge: of the held-out tosses.
        say: called with progress messages.
    """

    def __init__(self, evidence: Restarts, judge: Judge, say: Callable[[str], None], progress: Progress | None = None):
        self.evidence, self.judge, self.say = evidence, judge, say
        self.progress = Progress() if progress is None else progress
        self.silent: dict[str, str] = {}  # effect -> reason why no window can show it

    def candidates(self, world: World) -> list[tuple[str, str]]:
        """Effects that could act on the object and are not in the world yet."""
        taken = {e.effect for e in world.effects}
        names = [n for n, e in sorted(REGISTRY.items()) if n not in taken and self.evidence.sees(e)]
        self.silent |= {n: NO_TOSS_HAS[effect(n).needs] for n in names if effect(n).needs in NO_TOSS_HAS}
        names = [n for n in names if effect(n).needs not in NO_TOSS_HAS]
        return [(n, place) for n in names for place in effect(n).targets(self.evidence.model)]

    def start(self, world: World, n_fixed: int | None = None) -> Tossed:
        """Return the initial state: the world as given."""
        return Tossed(world, self.judge.losses([world])[0])

    def announce(self, state: Tossed) -> None:
        """Report the model and its held-out error."""
        self.say(f"{state.world.label}: held-out {floors(self.judge.mean(state.loss))} x noise")

    def offers(self, state: Tossed, n_fixed: int) -> list[Tried]:
        """Return the best sizes from screening, fitted and judged; accepted ones first."""
        starts = self.screened(state.world)
        fits = self.fits([state.world.add(p) for p in starts[: RULES.tosses_fitted]], n_fixed)
        level = stats.norm.isf(RULES.tosses_level / max(len(starts), 1))
        out = [self._tried(f, p, state.loss, level) for f, p in zip(fits, starts[: RULES.tosses_fitted], strict=True)]
        return sorted(out, key=lambda t: (bool(t.rejected), float(t.loss.sum())))

    def take(self, state: Tossed, trial: Tried, trials: list[Tried], n_fixed: int) -> None:
        """Return the state after a trial is accepted."""
        state.steps.append((trial, trials))
        state.world, state.loss = trial.world, trial.loss

    def screened(self, world: World) -> list[EffectInstance]:
        """Return each candidate that lowers the fitted error, at its best size, best first."""
        places = self.candidates(world)
        rows = [(n, w, {p: v}) for n, w in places for p in effect(n).magnitudes for v in sizes(effect(n).params[p])]
        placed = [EffectInstance.of(n, w, **v) for n, w, v in rows]
        before, *after = self.evidence.residuals([world, *(world.add(p) for p in placed)])
        total = float(before @ before)
        best: dict[tuple[str, str], tuple[float, EffectInstance]] = {}
        moved = dict.fromkeys(places, 0.0)
        for p, r in zip(placed, after, strict=True):
            key, gain = (p.effect, p.where), total - float(r @ r)
            moved[key] = max(moved[key], float(np.sum((r - before) ** 2)) / total)
            if gain > best.get(key, (0.0, p))[0]:
                best[key] = gain, p
        for name, _ in (k for k, share in moved.items() if share < RULES.tosses_trace):
            self.silent.setdefault(name, "no size of it moves the object otherwise")
        return [p for _, p in sorted(best.values(), key=lambda b: -b[0])]

    def fits(self, worlds: Sequence[World], n_fixed: int) -> list[World]:
        """Fit all added effects jointly; results are cached."""
        return [
            kept(self.progress, "fit", w, partial(line_searches, self.evidence, w, range(n_fixed, len(w.effects))))
            for w in worlds
        ]

    def _tried(self, fit: World, placed: EffectInstance, loss: np.ndarray, level: float) -> Tried:
        after = self.judge.losses([fit])[0]
        gain, why = self.judge.gain(loss, after), ""
        if gain.relative < self.evidence.least_gain:
            why = f"held-out gain {100 * gain.relative:.1f} % is under {100 * self.evidence.least_gain:.0f} %"
        elif gain.z < level:
            why = f"held-out gain is {gain.z:.1f} standard errors, under {level:.1f}"
        return Tried(fit, placed, after, gain, why)

    def rivals(self, world: World, n_fixed: int) -> dict[str, list[EffectInstance]]:
        """Return for each added effect those that do as well in its place on the held-out tosses."""
        out, best = {}, self.judge.losses([world])[0]
        for e in world.effects[n_fixed:]:
            without = world.without(e.effect, e.where)
            before = self.judge.losses([without])[0]
            others = [p for p in self.screened(without) if p.effect != e.effect][: RULES.tosses_fitted]
            fits = self.fits([without.add(p) for p in others], n_fixed)
            same = [
                p
                for p, f in zip(others, fits, strict=True)
                if equal(self.judge, self.judge.losses([f])[0], best, self.judge.mean(before))
            ]
            out[e.label] = same
        return out


def shows_from(search: ObjectSearch, world: World) -> list[ShowsFrom]:
    """Return for each effect that a world lacks the parameter values that held-out tosses do not show.

    On each side of null these reach up to the first tried size that passes the search's held-out tests with
    probability `POWER`. If it passes easily, the limit is scaled down, the trace growing linearly, but not below a
    size that fails.
    """
    judge, places = search.judge, search.candidates(world)

    def work_out() -> list:
        rows = [(n, w, p, v) for n, w in places for p in effect(n).magnitudes for v in sizes(effect(n).params[p])]
        worlds = [world.add(EffectInstance.of(n, w, **{p: v})) for n, w, p, v in rows]
        before, *after = judge.evidence.residuals([world, *worlds])
        share, total = search.evidence.least_gain, float(before @ before)
        level, none = float(stats.norm.isf(RULES.tosses_level / max(len(places), 1))), np.zeros((len(before), 0))
        least = [
            least_alone(Trace.of(before - r, none, before, judge.blocks), share / (1.0 - share) * total, level)
            for r in after
        ]
        return [[*row, times if np.isfinite(times) else None] for row, times in zip(rows, least, strict=True)]

    hidden: dict[tuple[str, str], dict[str, tuple[float, float] | None]] = {}
    asked: dict[tuple[str, str, str], list[tuple[float, float]]] = {}
    for name, where, parameter, v, times in search.progress.recall(["shows from", model_text(world)], work_out):
        asked.setdefault((name, where, parameter), []).append((v, np.inf if times is None else times))
    for (name, where, parameter), tries in asked.items():
        hidden.setdefault((name, where), {})[parameter] = _hidden(effect(name).params[parameter], tries)
    return [{"effect": name, "where": where, "between": between} for (name, where), between in hidden.items()]


def _hidden(param: Param, tries: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Return the range around null that does not show, from the tried values and each one's required multiple.

    None if no value shows; on a side without a detectable value the range extends to the bound.
    """
    log = param.scale == "log"
    ends = [param.low, param.high]
    for side, sign in enumerate((-1.0, 1.0)):
        unseen = 0.0
        away = [(sign * (np.log(v / param.null) if log else v - param.null), times) for v, times in tries]
        for size, times in sorted(a for a in away if a[0] > 0):
            if times <= 1.0:
                end = sign * max(unseen, size * times)
                ends[side] = param.null * float(np.exp(end)) if log else param.null + end
                break
            unseen = size
    return None if ends == [param.low, param.high] else (float(ends[0]), float(ends[1]))


def kept(progress: Progress, question: str, world: World, work_out: Callable[[], World]) -> World:
    """Return a world with the values and intervals stored for a question, or computed and stored now."""

    def plain() -> list:
        effects = work_out().effects
        return [{k: [v.value, v.low, v.high] for k, v in e.params.items()} for e in effects]

    answer = progress.recall([question, model_text(world)], plain)
    known = [{k: _value(*v) for k, v in params.items()} for params in answer]
    return replace(world, effects=tuple(replace(e, params=p) for e, p in zip(world.effects, known, strict=True)))


def _value(value: float, low: float | None, high: float | None) -> Value:
    return Value(float(value), None if low is None else float(low), None if high is None else float(high))


def diagnose_object(
    world: World,
    model: ObjectModel,
    fitted: Sequence[ObjectRecording],
    held_out: Sequence[ObjectRecording],
    *,
    seed: int = 0,
    nthread: int = 2,
    say: Callable[[str], None] = lambda _: None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find the contact effects that an object's model lacks; errors are on the held-out tosses.

    `progress` stores results, so that a killed diagnosis with the same arguments can resume.

    Raises:
        UserError: recordings of another object, without free flight or without contact.
    """
    first = next(iter(WINDOWS.values()))
    evidence = Restarts(fitted, model, first, nthread=nthread)
    judged = Restarts(held_out, model, first, sigma=evidence.sigma, nthread=nthread)
    judge = Judge(judged)
    progress = Progress() if progress is None else progress
    search = ObjectSearch(evidence, judge, say, progress)
    n_fixed = len(world.effects)
    state = search.run(world)
    free, rng = range(n_fixed, len(state.world.effects)), np.random.default_rng([seed, 19])
    final = kept(progress, "intervals", state.world, partial(with_intervals, evidence, state.world, free, rng))
    say("what else would do as well")
    equals = search.rivals(final, n_fixed)
    before, after = (judge.mean(judge.losses([w])[0]) for w in (world, final))
    distance = [judged.missed(w)[0] for w in (world, final)]
    rms = [float(np.sqrt(np.mean(d**2))) for d in distance]
    seen = (rms[0] / judged.floor, rms[1] / judged.floor)
    verdict = decide(before, after, len(final.effects) - n_fixed, [], [], errors=seen)
    named = [label for label, others in equals.items() if others]
    if verdict.verdict == "identified" and named:
        verdict = type(verdict)("ambiguous", f"these tosses cannot tell {', '.join(named)} from other effects")
    say("what each length of window can tell")
    told = partial(windows, fitted, held_out, world, final, model, evidence.sigma, seed, nthread)
    rows = progress.recall(["windows", model_text(final)], told)
    result = with_origin(final, n_fixed, fitted, held_out, *rms, verdict.partial)  # type: ignore[arg-type]
    record: DiagnosisRecord = {
        "format": "vispeg-diagnosis/1",
        "object": model.name,
        "verdict": verdict.verdict,
        "reason": verdict.reason,
        "effects": [_effect(e, equals.get(e.label, [])) for e in result.effects[n_fixed:]],
        "ladder": _ladder(evidence, judged, world, state),
        "noise_floor": {"value": judged.floor, "unit": "m RMS", "from": judged.floor_from},
        "unexplained": verdict.unexplained,
        "next_experiment": _next(search.silent, rows),
        "candidates": _candidates(state),
        "recordings": {"fit": [r.name for r in fitted], "validate": [r.name for r in held_out]},
        "restarts": rows,
        "contact": contact_numbers(model, result),
        "shows_from": shows_from(search, final),
        "notes": [f"{n}({model.name}) cannot be told: {why}" for n, why in search.silent.items()],
    }  # fmt: skip
    return Diagnosis(record, result, {})


def contact_numbers(model: ObjectModel, world: World) -> dict[str, float]:
    """Return friction coefficient, time constant (s), damping ratio and restitution of the object's contacts."""
    from mujoco.batch import Batch

    from vispeg.sim.placement import activate
    from vispeg.sim.state import Fields

    compiled = model.compile(1e-3)
    batch = Batch(compiled, 1)
    fields = Fields(batch, model)
    for a in activate(model, [world]):  # type: ignore[arg-type]
        a.effect.write(fields, a.p)
    geom = int(np.flatnonzero(compiled.geom_bodyid == compiled.body(model.name).id)[0])
    time, ratio = fields["geom_solref"][0, geom]
    friction = fields["geom_friction"][0, geom, 0]
    out = {"friction": float(friction), "time_constant_s": float(time), "damping_ratio": float(ratio)}
    return out | ({"restitution": float(rebound(np.array(ratio)))} if ratio > 0 and time > 0 else {})


def windows(
    fitted: Sequence[ObjectRecording],
    held_out: Sequence[ObjectRecording],
    before: World,
    after: World,
    model: ObjectModel,
    sigma: np.ndarray,
    seed: int,
    nthread: int,
) -> list[Mapping[str, object]]:
    """Return for each window length the errors of both models on the held-out tosses, and each parameter's profile."""
    rows = []
    rng = np.random.default_rng([seed, 41])
    for label, seconds in WINDOWS.items():
        judged = Restarts(held_out, model, seconds, sigma=sigma, nthread=nthread)
        row: dict[str, object] = {"window": label, "count": sum(len(w.first) for w in judged.items)}
        for name, world in (("before", before), ("after", after)):
            distance, turn = judged.missed(world)
            row[name] = {"median_m": float(np.median(distance)), "median_rad": float(np.median(turn)),
                         "rms_m": float(np.sqrt(np.mean(distance**2)))}  # fmt: skip
        evidence = Restarts(fitted, model, seconds, sigma=sigma, nthread=nthread)
        parameters: list[Mapping[str, object]] = []
        for e in after.effects[len(before.effects) :]:
            for name in effect(e.effect).magnitudes:
                got: Profile = profile(evidence, after, e, name, rng)
                parameters.append({
                    "parameter": got.label, "best": got.best, "low": got.low, "high": got.high, "told": got.determined,
                    "profile": {"value": got.values.tolist(), "error": got.error.tolist()},
                })  # fmt: skip
        rows.append({**row, "parameters": parameters})
    return rows


def _effect(e: EffectInstance, others: Sequence[EffectInstance]) -> FoundEffect:
    entry: Any = without_origin(e)
    return entry | {"indistinguishable_from": [{"effect": o.effect, "where": o.where} for o in others]}


def _ladder(evidence: Restarts, judged: Restarts, world: World, state: Tossed) -> list[Rung]:
    labels = ["nominal", *(f"+ {best.placed.label}" for best, _ in state.steps)]
    worlds = [world, *(best.world for best, _ in state.steps)]
    rms = lambda e, w: float(np.sqrt(np.mean(e.missed(w)[0] ** 2)))  # noqa: E731
    return [
        {"model": label, "fit_error": rms(evidence, w), "heldout_error": rms(judged, w), "unit": "m RMS"}
        for label, w in zip(labels, worlds, strict=True)
    ]


def _candidates(state: Tossed) -> list[Candidate]:
    rows = [
        (t, t.rejected or f"{best.placed.label} explains more")
        for best, all_ in state.steps
        for t in all_
        if t is not best
    ]
    rows += [(t, t.rejected) for t in state.last]
    return [
        {"effect": t.placed.effect, "where": t.placed.where, "heldout_gain": round(t.gain.relative, 5),
         "gain_standard_errors": round(t.gain.z, 2), "rejected_because": why}
        for t, why in rows
    ]  # fmt: skip


def _next(silent: Collection[str], rows: Sequence[Mapping[str, Any]]) -> NextMotion | None:
    weak = sorted({p["parameter"] for p in rows[0]["parameters"] if not p["told"]})
    if weak:
        return {"motion": "tosses with more single bounces, from 0.1 to 0.5 m", "why": f"would tell {', '.join(weak)}",
                "how": TOSS}  # fmt: skip
    if "object_mass" in silent:
        why = "a scale tells its mass: in free flight and against a fixed table only forces over mass can be told"
        return {"motion": "", "why": why, "how": WEIGH}
    return None
