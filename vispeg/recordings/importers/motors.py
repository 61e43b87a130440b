"""Angles, speeds and torques of the motors become those of the joints that they turn.

With `q = A m` for motors m, power `tau_m . dm = tau . dq` for every motion asks for `tau = A^-T tau_m`: a gear that
makes a joint slower makes it stronger, and coupled wrists share their torques as they share their angles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.columns import columns_of
from vispeg.recordings.importers.mapping import ColumnMap
from vispeg.recordings.importers.turns import straightened

WORST = 1e6  # condition beyond which motors do not determine the joints


def joint_side(
    columns: Mapping[str, np.ndarray], joints: Sequence[str], mapping: ColumnMap, source: Path
) -> dict[str, np.ndarray]:
    """Return the columns (n,) of a recording with what the map states as the motors' turned to the joints' side.

    Angles and speeds of a joint are sums over motors, torques the reverse; loads too, where they are signed. Jumps of
    whole turns are undone on the motor's side, where they happen.

    Raises:
        UserError: a motor without readings, or motors that do not determine the joints.
    """
    out = dict(columns)
    if not mapping.motors:
        return out
    turn = matrix(joints, mapping, source)
    back = np.linalg.inv(turn).T
    for signal in ("q", "q_cmd", "dq", "dq_cmd", "tau", "tau_cmd", "load"):
        names = columns_of(signal, joints)
        there = [j for j, name in enumerate(names) if name in columns]
        if not there or (signal == "load" and all(np.nanmin(columns[names[j]]) >= 0 for j in there)):
            continue
        weights = turn if signal in ("q", "q_cmd", "dq", "dq_cmd") else back
        lacking = [names[k] for j in there for k in np.flatnonzero(weights[j]) if k not in there]
        if lacking:
            raise UserError("a motor has no readings", file=mapping.file or source, key="motors", got=lacking[0])
        values = np.stack([columns[names[j]] for j in there], axis=1).astype(float)
        if signal in ("q", "q_cmd"):
            values, _ = straightened(values, np.tile([-np.inf, np.inf], (len(there), 1)), columns.get("episode"))
        out |= dict(zip([names[j] for j in there], combined(values, weights[np.ix_(there, there)]).T, strict=True))
    return out


def matrix(joints: Sequence[str], mapping: ColumnMap, source: Path) -> np.ndarray:
    """Return A (nj, nj) of `q = A m`, in the order of the recording's joints; raises UserError as `joint_side`."""
    order = {joint: j for j, joint in enumerate(joints)}
    out, file = np.eye(len(order)), mapping.file or source
    for joint, terms in mapping.motors.items():
        for name in (joint, *terms):
            if name not in order:
                raise UserError("is not in the log", file=file, key="motors", got=name, choices=joints)
        out[order[joint]] = 0.0
        for name, factor in terms.items():
            out[order[joint], order[name]] = factor
    scaled = out / np.linalg.norm(out, axis=1, keepdims=True)  # a gear of 1 beside one of 160 is no trouble
    if np.linalg.cond(scaled) > WORST:
        said = "two joints turn by the same motors in one proportion, so that their torques cannot be told"
        raise UserError(said, file=file, key="motors", got={k: dict(v) for k, v in mapping.motors.items()})
    return out


def combined(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return `values @ weights.T` (n, nj), in which a missing reading counts for those alone that it goes into."""
    out = np.zeros_like(values)
    for j, row in enumerate(weights):
        for k in np.flatnonzero(row):
            out[:, j] += row[k] * values[:, k]
    return out
