"""Build the parts of diagnosis.json: effects, ladder, candidates, channels, correlations, notes on encoders.

In all of them the effects after the first `n_fixed` of a world were added by the search, `evidence` holds the fitted
and `judged` the held-out recordings. The ladder is the list of models from the user's to the final one, with their
errors.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.beginning import ANEW
from vispeg.diagnosis.conclusion.shares import Share
from vispeg.diagnosis.findings import Rivals, Score, Trial
from vispeg.diagnosis.schema import Candidate, Channel, Correlations, FoundEffect, JointError, Moved, Rung
from vispeg.diagnosis.selection.state import State
from vispeg.identify.evidence import Evidence
from vispeg.recordings.checks.quality import quantization
from vispeg.recordings.recording import Recording
from vispeg.worlds.model_file import without_origin
from vispeg.worlds.places import ALL
from vispeg.worlds.world import World


def screening(state: State) -> list[Score]:
    """Return the candidates tried in the first step, then the 20 best of the last screening, with their scores."""
    first = state.steps[0][1] if state.steps else []
    return [t.score for t in first] + state.screening[:20]


def with_origin(
    world: World,
    n_fixed: int,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    before: float,
    after: float,
    partial: bool,
    unsure: Collection[str] = (),
) -> World:
    """Return the world with its added effects marked: their origin, whether they are partial, whether tentative.

    Args:
        world: the final model.
        n_fixed: number of effects that stay as they are.
        fitted, held_out: the recordings.
        before, after: held-out error of the user's model and of the final one.
        partial: whether part of the error remains. An encoder's resolution is never marked so, as no fit moves it.
        unsure: labels of the tentative effects.
    """
    origin = {
        "fitted_on": [r.name for r in fitted],
        "validated_on": [r.name for r in held_out],
        "heldout_error_before": float(before),
        "heldout_error_after": float(after),
    }
    added = (
        replace(
            e,
            origin=origin,
            partial=partial and not effect(e.effect).overrides("resolution"),
            tentative=e.label in unsure,
        )
        for e in world.effects[n_fixed:]
    )
    effects = world.effects[:n_fixed] + tuple(added)
    return replace(world, effects=effects)


def effects(
    world: World, n_fixed: int, rivals: Sequence[Rivals], fitted: World, explained: Mapping[str, Share]
) -> list[FoundEffect]:
    """Return the effects found, each with those that these recordings cannot tell from it, and what it explains.

    `fitted` is the same model with intervals due to noise alone; those of `world` count the error of the model's form
    too. `explained` has what is known of it by the effects' labels.
    """
    by_label = {r.label: r for r in rivals}
    out = []
    for e in world.effects[n_fixed:]:
        placed = without_origin(e)
        params: dict[str, dict[str, object]] = {name: {**values} for name, values in placed["params"].items()}
        for name, v in next(f for f in fitted.effects if f.label == e.label).params.items():
            if v.low is not None and v.high is not None and v != e.params[name]:
                params[name]["statistical"] = [float(v.low), float(v.high)]
        equals = by_label[e.label].equals if e.label in by_label else ()
        others = [{"effect": t.score.key[0], "where": t.score.key[1]} for t in equals]
        entry = {
            **placed,
            "params": params,
            "indistinguishable_from": others,
            **explained.get(e.label, {}),
        }
        out.append(cast("FoundEffect", entry))
    return out


def ladder(
    evidence: Evidence, judged: Evidence, state: State, nominal: World, read: tuple[str, World] | None = None
) -> list[Rung]:
    """Return the error of each model from the user's (`nominal`) to the final one, fitted and held out.

    `read` is the label and the model of the step that reads effects directly from the data; None if there are none.
    """
    models = [("nominal", nominal)]
    models += [] if read is None else [read]
    models += [] if state.opened is None else [(ANEW, state.opened)]
    models += [(f"+ {best.score.label}", best.fit.world) for best, _ in state.steps]
    if len(models) > 1 and state.world.label != models[-1][1].label:
        models.append(("after backward deletion", state.world))
    elif len(models) > 1:  # its values may have been refitted since: the last rung is the model that is written
        models[-1] = (models[-1][0], state.world)
    worlds = [world for _, world in models]
    unit = f"{judged.unit} RMS"
    return [
        {"model": label, "fit_error": fit, "heldout_error": held, "unit": unit}
        for (label, _), fit, held in zip(models, evidence.errors(worlds), judged.errors(worlds), strict=True)
    ]


def candidates(state: State, rivals: Sequence[Rivals]) -> list[Candidate]:
    """Return the rejected candidates of the search and all tried rivals, with the reasons."""
    out = []
    for best, trials in state.steps:
        for t in trials:
            if t.score is best.score:
                continue
            why = t.rejected or f"{best.score.label} explains the held-out data as well or better"
            out.append(_candidate(t, why, state.n_fixed))
    out += [_candidate(t, t.rejected, state.n_fixed) for t in state.last]
    listed = {(c["effect"], c["where"]) for c in out}
    for r in rivals:
        for t in r.tried:
            if t.score.key not in listed:
                compared = "indistinguishable from" if t in r.equals else "explains less than"
                out.append(_candidate(t, t.rejected or f"{compared} {r.label}", state.n_fixed))
    return out


def _candidate(t: Trial, why: str, n_fixed: int) -> Candidate:
    """Return the entry of a rejected trial, with the added effects that its world had beside it."""
    beside = [e for e in t.fit.world.effects[n_fixed:] if not t.score.has(e)]
    return {
        "effect": t.score.key[0],
        "where": t.score.key[1],
        "tried_beside": [{"effect": e.effect, "where": e.where} for e in beside],
        "heldout_gain": round(t.gain.relative, 5),
        "gain_standard_errors": round(t.gain.z, 2),
        "rejected_because": why,
    }


def coarse_encoders(rec: Recording, judged: Evidence, world: World) -> list[str]:
    """Return messages on joints of a recording that are read in steps above twice the stated noise.

    Joints for which the world has an encoder resolution are left out.
    """
    steps = {joint: quantization(rec.q[:, j]) for j, joint in enumerate(rec.joints)}
    sigma = judged.items[0].recording.noise.get("q", 0.0)
    known = {e.where for e in world.effects if effect(e.effect).overrides("resolution")}
    steps = {joint: step for joint, step in steps.items() if joint not in known and ALL not in known}
    unstated = "" if "q" in rec.noise else "; state the encoders' noise (`noise: q`) to have that in the model"
    return [
        f"{joint} is read in steps of {step:.2g} rad{unstated}"
        for joint, step in steps.items()
        if step and step > 2 * sigma
    ]


def correlations(state: State) -> Correlations | None:
    """Return the correlations between the estimates of the final fit; None if nothing was fitted."""
    if state.fit is None:
        return None
    labels = [f"{state.world.effects[a.index].label}.{a.name}" for a in state.fit.space.axes]
    return {"labels": labels, "matrix": np.round(state.fit.correlation, 3).tolist()}


def moved(state: State) -> list[Moved]:
    """Return parameters of earlier effects that a later effect changed by over a tenth of a typical size."""
    out: list[Moved] = []
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


def joint_errors(rows: Sequence[Channel]) -> list[JointError]:
    """Return the errors of a comparison from its `channels`; a column that was never read has none, and no noise."""
    out: list[JointError] = []
    for row in rows:
        error, floor = (row["before"], row["floor"]) if row["floor"] > 0 else (None, 0.0)
        times = None if error is None else error / floor
        out.append({"joint": row["joint"], "error": error, "floor": floor, "unit": row["unit"], "times_floor": times})
    return out


def channels(evidence: Evidence, predicted: list[np.ndarray], least: list[np.ndarray] | None) -> list[Channel]:
    """Return the floor and the held-out errors of each column of each channel.

    Args:
        evidence: held out.
        predicted: for each item (nworld, m, nch); the first and the last world are the models before and after.
        least: for each item the residuals (m, nj) of the least squares of base parameters; None if there are none.
    """
    out, names = [], evidence.items[0].robot.joints
    for ((kind, unit, j), pairs), floor in zip(evidence.columns.items(), evidence.floors, strict=True):
        placed = [(evidence.items[i], predicted[i], k) for i, k in pairs]
        column = [(item.measured[:, k], y[:, :, k], item.valid[:, k]) for item, y, k in placed]
        count = max(sum(int(v.sum()) for *_, v in column), 1)
        error = [
            np.sqrt(sum(np.sum((m - y[w])[v] ** 2) for m, y, v in column) / count) for w in range(len(predicted[0]))
        ]
        row: Channel = {
            "channel": kind,
            "joint": names[j],
            "floor": float(floor),
            "before": float(error[0]),
            "after": float(error[-1]),
            "unit": f"{unit} RMS",
        }
        if least is not None:
            row["least_squares"] = float(np.sqrt(sum(np.sum(r[:, j] ** 2) for r in least) / count))
        out.append(row)
    return out
