"""The last steps of every importer: convert readings of motors to those of joints, and build a validated recording."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.columns import JOINT_SIGNALS, columns_of
from vispeg.recordings.importers.clock import cleaned
from vispeg.recordings.importers.mapping import ColumnMap, Source
from vispeg.recordings.importers.turns import beside, straightened
from vispeg.recordings.load import assemble
from vispeg.recordings.recording import Recording
from vispeg.recordings.schema import FORMAT, header_from
from vispeg.recordings.tables.table import Table

EPOCH = 1e6  # s; times that begin beyond it are dates, and are shifted to begin at 0, so that they keep more digits
WORST = 1e6  # condition number of the motor matrix (rows of norm 1) from which it counts as singular


def joints_of(joints: Sequence[str], mapping: ColumnMap) -> list[str]:
    """Return the joints of the recording: the list `recording.joints` of the map if it has one, else `joints`."""
    stated = mapping.recording.get("joints", list(joints))
    return [str(name) for name in stated] if isinstance(stated, list) else list(joints)


def si(values: np.ndarray, source: Source) -> np.ndarray:
    """Convert a column's raw values to SI units, by its factor and offset."""
    return values if source.factor == 1.0 and source.offset == 0.0 else values * source.factor + source.offset


def build(
    columns: Mapping[str, np.ndarray],
    source: Path,
    robot: str,
    joints: Sequence[str],
    mapping: ColumnMap,
    numbers: range | np.ndarray | None = None,
) -> Recording:
    """Build a validated recording from columns (n,) in SI units, named as in samples.csv.

    Args:
        columns: name -> values; `time`, `q.joint1` and so on.
        source: the file that they come from, named in error messages.
        robot: name or file of the robot.
        joints: the robot's joints.
        mapping: the map; the keys of its `recording` go into the header.
        numbers: number of each sample's row in the source, for messages; by default counted from 0.

    Raises:
        UserError: no column `time`, no samples, a signal of some joints only, motors as for `joint_side`, or anything
            that a recording may not have.
    """
    time = columns.get("time")
    if time is None:
        raise UserError("has no time", file=source, expected="a column `time`, or a map that says which it is")
    columns, numbers = cleaned(dict(columns), source, range(len(time)) if numbers is None else numbers)
    columns = joint_side(columns, joints_of(joints, mapping), mapping, source)
    _complete(columns, joints_of(joints, mapping), mapping, source)
    time = columns["time"]
    start = time[0] if len(time) else 0.0
    if np.isfinite(start) and abs(start) > EPOCH:
        columns["time"] = time - start
    steps = np.diff(time)
    steps = steps[steps > 0]
    rate = 1.0 / float(np.median(steps)) if len(steps) else 1.0
    data = {"format": FORMAT, "robot": robot, "joints": joints_of(joints, mapping), "rate_hz": _rounded(rate)}
    data |= {"notes": f"imported from {source.name}"} | dict(mapping.recording)
    origin = {target: column.name for target, column in mapping.columns.items() if column.name}
    table = Table(source, columns, list(columns), len(columns["time"]), numbers, origin=origin)
    if table.rows == 0:
        raise UserError("holds no samples", file=source)
    return assemble(header_from(data, mapping.file or source), table, Path(source.stem), mapping.file or source)


def _complete(columns: Collection[str], joints: Sequence[str], mapping: ColumnMap, source: Path) -> None:
    """Refuse a signal that a map or a file has for some of the joints only."""
    for signal in JOINT_SIGNALS:
        names = columns_of(signal, joints)
        lacking = [name for name in names if name not in columns]
        if not lacking or (len(lacking) == len(names) and signal != "q"):
            continue
        out = "`recording: {joints: [..]}` in a map without it" if signal == "q" else f"`{lacking[0]}: none` in a map"
        expected = f"a column of every joint, or {out}"
        raise UserError("is missing", file=mapping.file or source, key=lacking[0], expected=expected)


def _rounded(rate: float) -> float:
    """Round a rate to the whole number within 1 % of it: controllers run at 500 Hz, and 499.98 Hz is clock jitter."""
    nearest = round(rate)
    return float(nearest) if nearest and abs(rate / nearest - 1) < 0.01 else rate


def joint_side(
    columns: Mapping[str, np.ndarray], joints: Sequence[str], mapping: ColumnMap, source: Path
) -> dict[str, np.ndarray]:
    """Return the columns (n,), those of motor readings converted to joints; unchanged if the map states no motors.

    With q = A m of joint angles q and motor angles m, speeds are dq = A dm, and torques tau = A^-T tau_m. Loads convert
    as torques if they have a sign, and are kept if not. Jumps of angles by whole turns are removed first, and commands
    are shifted by whole turns to the measured angles, as both occur at the motors.

    Raises:
        UserError: a motor has no column for a signal that a joint's depends on, the map names a joint that is not
            recorded, or A is singular.
    """
    out = dict(columns)
    if not mapping.motors:
        return out
    of_angles = matrix(joints, mapping, source)  # A
    of_torques = np.linalg.inv(of_angles).T
    measured: dict[int, np.ndarray] = {}  # angles of motors without jumps
    for signal in ("q", "q_cmd", "dq", "dq_cmd", "tau", "tau_cmd", "load"):
        names = columns_of(signal, joints)
        present = [j for j, name in enumerate(names) if name in columns]
        if not present or (signal == "load" and all(np.nanmin(columns[names[j]]) >= 0 for j in present)):
            continue
        weights = of_angles if signal in ("q", "q_cmd", "dq", "dq_cmd") else of_torques
        lacking = [names[k] for j in present for k in np.flatnonzero(weights[j]) if k not in present]
        if lacking:
            message = "a joint depends on a motor whose column is missing"
            raise UserError(message, file=mapping.file or source, key="motors", got=lacking[0])
        values = np.stack([columns[names[j]] for j in present], axis=1).astype(float)
        if signal == "q":
            values, _ = straightened(values, episode=columns.get("episode"))
            measured = dict(zip(present, values.T, strict=True))
        elif signal == "q_cmd":
            q = np.stack([measured.get(j, np.full(len(values), np.nan)) for j in present], axis=1)
            values = beside(values, q, columns.get("episode"))
        converted = combined(values, weights[np.ix_(present, present)])
        out |= dict(zip([names[j] for j in present], converted.T, strict=True))
    return out


def matrix(joints: Sequence[str], mapping: ColumnMap, source: Path) -> np.ndarray:
    """Return A (nj, nj) of `q = A m`: rows are joints, columns are motors, both in the order of `joints`.

    Raises:
        UserError: the map names a joint that is not in `joints`, or A is singular.
    """
    order = {joint: j for j, joint in enumerate(joints)}
    out, file = np.eye(len(order)), mapping.file or source
    for joint, terms in mapping.motors.items():
        for name in (joint, *terms):
            if name not in order:
                raise UserError("is no joint of the recording", file=file, key="motors", got=name, choices=joints)
        out[order[joint]] = 0.0
        for name, factor in terms.items():
            out[order[joint], order[name]] = factor
    scaled = out / np.linalg.norm(out, axis=1, keepdims=True)  # gears of 1 and 160 in one arm are fine
    if np.linalg.cond(scaled) > WORST:
        message = "the joints do not determine the motors, so torques cannot be converted: the matrix is singular"
        raise UserError(message, file=file, key="motors", got={k: dict(v) for k, v in mapping.motors.items()})
    return out


def combined(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return `values @ weights.T` (n, nj), in which a NaN makes only those columns NaN that have a weight for it.

    `values` are (n, nj), `weights` (nj, nj).
    """
    out = np.zeros_like(values)
    for j, row in enumerate(weights):
        for k in np.flatnonzero(row):
            out[:, j] += row[k] * values[:, k]
    return out
