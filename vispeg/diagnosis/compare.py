"""`compare`: a model against recordings, nothing fitted: how far off, at which joint, and in which regime."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vispeg.diagnosis.localise import maps, missing_torque, peaks, where_it_fails
from vispeg.diagnosis.subsets import subsets
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import evidence_for
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import records
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Comparison:
    """The record (compare.json) and the arrays behind its pictures."""

    record: dict[str, Any]
    arrays: dict[str, np.ndarray]


def compare(world: World, recordings: Sequence[Recording], *, nthread: int = 1, label: str | None = None) -> Comparison:
    """Drives the model as the robot was driven and says how far it is off.

    Args:
        world: the model; nothing of it is fitted, so every recording is held out.
        recordings: of one robot.
        nthread: threads of the simulation.
        label: what the table calls the model.

    Raises:
        UserError: recordings that cannot be compared with the model.
    """
    evidence = evidence_for(world, recordings, nthread, h_max=1e-3)
    predicted = evidence.simulated([world])
    residual = evidence.residuals([world])[0]
    missing = [missing_torque(item, y[0]) for item, y in zip(evidence.items, predicted, strict=True)]
    joints = evidence.items[0].robot.joints
    drawn = maps(missing)
    unit = f"{evidence.unit} RMS"
    stated = all(("q" if evidence.unit == "rad" else "tau") in r.noise for r in recordings)
    record = {
        "format": "vispeg-compare/1",
        "ladder": [
            {
                "model": label or world.label,
                "fit_error": None,
                "heldout_error": evidence.angle_rms(residual),
                "unit": unit,
            }
        ],
        "noise_floor": {"value": evidence.floor, "unit": unit, "from": "stated noise" if stated else "estimated"},
        "chi2": float(np.sum(residual**2) / max(evidence.count, 1)),
        "joints": _joints(evidence, predicted),
        "where_it_fails": where_it_fails(missing, joints),
        "residual_peaks": peaks(drawn, joints),
        "recordings": {"fit": [], "validate": [r.name for r in recordings]},
        "windows": records(recordings),
        "notes": list(evidence.notes),
    }
    arrays = _arrays(evidence, predicted) | subsets(evidence, world, len(world.effects))
    for axis, (edges, grid) in drawn.items():
        arrays[f"map/{axis}/edges"], arrays[f"map/{axis}/before"] = edges, grid
    return Comparison(record, arrays)


def _joints(evidence: Evidence, predicted: list[np.ndarray]) -> list[dict[str, Any]]:
    """Per joint: RMS error and noise, their ratio, and RMS torque error where torque was measured."""
    out = []
    for j, joint in enumerate(evidence.items[0].robot.joints):
        error, floor = _rms(evidence, predicted, j), float(evidence.floors[j])
        row: dict[str, Any] = {"joint": joint, "error": error, "floor": floor, "unit": f"{evidence.unit} RMS"}
        row["times_floor"] = error / floor if floor > 0 else None
        if all(i.beside == "torque" for i in evidence.items):
            row["torque_error"] = _rms(evidence, predicted, j + evidence.items[0].nj)
        if all(i.beside == "load" for i in evidence.items):
            row["load_error"] = _rms(evidence, predicted, j + evidence.items[0].nj)
        out.append(row)
    return out


def _rms(evidence: Evidence, predicted: list[np.ndarray], channel: int) -> float:
    total, count = 0.0, 0
    for item, y in zip(evidence.items, predicted, strict=True):
        valid = item.valid[:, channel]
        total += float(np.sum((item.measured[valid, channel] - y[0][valid, channel]) ** 2))
        count += int(valid.sum())
    return float(np.sqrt(total / max(count, 1)))


def _arrays(evidence: Evidence, predicted: list[np.ndarray]) -> dict[str, np.ndarray]:
    out = {"joints": np.array(evidence.items[0].robot.joints), "unit": np.array(evidence.unit)}
    for r, (item, y) in enumerate(zip(evidence.items, predicted, strict=True)):
        nj = item.nj
        out |= {f"{r}/time": item.segment.time, f"{r}/name": np.array(item.name)}
        out |= {f"{r}/measured": item.measured[:, :nj], f"{r}/before": y[0][:, :nj]}
        if item.beside == "torque":
            out |= {f"{r}/measured_tau": item.measured[:, nj:], f"{r}/before_tau": y[0][:, nj:]}
    return out
