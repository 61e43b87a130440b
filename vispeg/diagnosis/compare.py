"""`compare` in joints: errors of a model against recordings, without a fit.

It says how large the errors are over the noise, at which joint, and in which regime (velocity reversal, high load).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vispeg.diagnosis.conclusion.subsets import subsets
from vispeg.diagnosis.evidence.localise import maps, missing_torque, peaks, where_it_fails
from vispeg.diagnosis.schema import ComparisonRecord, JointError, Lost
from vispeg.diagnosis.traces import arrays, traces
from vispeg.identify.channels import Item
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import evidence_for
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import records
from vispeg.sim.rollout import simulate
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Comparison:
    """The record (compare.json), the arrays behind its pictures, and what cameras saw.

    Attributes:
        pictures: `pictures` of compare.json, which also stands beside another channel's record; empty if no camera's
            pictures were compared.
    """

    record: ComparisonRecord
    arrays: dict[str, np.ndarray]
    pictures: Mapping[str, object] = field(default_factory=dict)


def compare(world: World, recordings: Sequence[Recording], *, nthread: int = 1, label: str | None = None) -> Comparison:
    """Drive the model with the recorded commands (or along the measured motion, for torques) and return its errors.

    Every model is compared under the recorded controller, so that errors of two models are of one loop. `diagnose`
    replaces a loop from which the given model drifts (`without_drift`), so the same model has another error there.

    Args:
        world: the model; nothing of it is fitted, so every recording is held out.
        recordings: of one robot.
        nthread: threads of the simulation.
        label: the model's name in the record; by default its effects.

    Raises:
        UserError: recordings that cannot be compared with the model.
    """
    evidence = evidence_for(recordings, nthread)
    predicted = evidence.simulated([world])
    residual = evidence.residuals([world])[0]
    lost = diverged(evidence, world, predicted)
    pairs = [(item, y) for item, y in zip(evidence.items, predicted, strict=True) if np.isfinite(y).all()]
    missing = [missing_torque(item, y[0]) for item, y in pairs]
    joints = evidence.items[0].robot.joints
    drawn = maps(missing) if missing else {}
    unit = f"{evidence.unit} RMS"
    record: ComparisonRecord = {
        "format": "vispeg-compare/1",
        "ladder": [
            {
                "model": label or world.label,
                "fit_error": None,
                "heldout_error": _error(pairs) if lost else evidence.rms_error(residual),
                "unit": unit,
            }
        ],
        "noise_floor": {"value": evidence.floor, "unit": unit, "from": evidence.floor_from},
        "chi2": evidence.chi2(residual),
        "joints": _joints(evidence, pairs),
        "diverged": lost,
        "where_it_fails": where_it_fails(missing, joints) if missing else [],
        "residual_peaks": peaks(drawn, joints),
        "recordings": {"fit": [], "validate": [r.name for r in recordings]},
        "windows": records(recordings),
        "notes": list(evidence.notes),
    }
    drawing = arrays(traces(evidence.items, predicted), joints) | subsets(evidence, world, len(world.effects))
    for axis, (edges, grid) in drawn.items():
        drawing[f"map/{axis}/edges"], drawing[f"map/{axis}/before"] = edges, grid
    return Comparison(record, drawing)


def diverged(evidence: Evidence, world: World, predicted: Sequence[np.ndarray]) -> list[Lost]:
    """Return the name of each item whose rollout diverged, and the time of divergence in s from the item's start."""
    out: list[Lost] = []
    for item, y in zip(evidence.items, predicted, strict=True):
        if not np.isfinite(y).all():
            step = evidence.step_of(item.segment.control.mode, world)
            response = simulate(item.robot, [world], [item.segment], h_max=step, along=True)[0]
            out.append({"recording": item.name, "time_s": float(response.diverged_at[0])})
    return out


Pairs = Sequence[tuple[Item, np.ndarray]]  # each item that did not diverge, with its prediction (1, m, nch)


def _error(pairs: Pairs) -> float | None:
    """Return the RMS over joints of their RMS errors in the items that did not diverge; None if all diverged."""
    joints = [_rms(pairs, j) for j in range(pairs[0][0].nj)] if pairs else []
    known = [error for error in joints if error is not None]
    return float(np.sqrt(np.mean(np.square(known)))) if known else None


def _joints(evidence: Evidence, pairs: Pairs) -> list[JointError]:
    """Return for each joint its RMS error, noise and their ratio.

    If every item also has joint torques, or every item a servo's load, their RMS error is added.
    """
    out: list[JointError] = []
    for j, joint in enumerate(evidence.items[0].robot.joints):
        error, floor = _rms(pairs, j), float(evidence.floors[j])
        row: JointError = {
            "joint": joint,
            "error": error,
            "floor": floor,
            "unit": f"{evidence.unit} RMS",
            "times_floor": error / floor if error is not None and floor > 0 else None,
        }
        beside = {i.beside for i in evidence.items}
        if beside == {"torque"}:
            row["torque_error"] = _rms(pairs, j + evidence.items[0].nj)
        elif beside == {"load"}:
            row["load_error"] = _rms(pairs, j + evidence.items[0].nj)
        out.append(row)
    return out


def _rms(pairs: Pairs, channel: int) -> float | None:
    """Return the RMS error in one column of the measured values, over all pairs; None if it was never read."""
    total, count = 0.0, 0
    for item, y in pairs:
        valid = item.valid[:, channel]
        total += float(np.sum((item.measured[valid, channel] - y[0][valid, channel]) ** 2))
        count += int(valid.sum())
    return float(np.sqrt(total / count)) if count else None
