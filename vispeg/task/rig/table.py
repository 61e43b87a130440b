"""Commanded flange poses as a table for a robot to replay: a column for time and one for each number of the pose.

The forces of a motion depend on the controller's springs, so columns may state these, with the same value on each row:
`kp.translation` and `kp.rotation` (1/s^2, critically damped), and `force_limit` (N). For a motion with its own posture,
columns `q_null.JOINT` hold the joint angles (rad) near which the arm begins and to which the null space is pulled.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.columns import columns_of
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Table
from vispeg.recordings.validate import check_finite, check_length, check_unit
from vispeg.task.rig.commanded import CellMotion

NULL, LIMIT = "q_null", "force_limit"
GAINS = ("kp.translation", "kp.rotation")


def text(motion: CellMotion, joints: Sequence[str]) -> str:
    """Return a motion as CSV text: `time` (s), flange pose in the base `ee_cmd.x` .. `ee_cmd.qz` (m and w x y z).

    Gains, force limit and posture follow if the motion states them, see the module's docstring.
    """
    head, rows = ["time", *columns_of("ee_cmd", ())], [motion.time, *motion.ee_cmd.T]
    constants: dict[str, float] = {}
    if motion.stiffness is not None:
        constants |= dict(zip(GAINS, motion.stiffness, strict=True))
    if motion.force_limit is not None:
        constants[LIMIT] = motion.force_limit
    if motion.posture is not None:
        constants |= dict(zip(columns_of(NULL, joints), motion.posture, strict=True))
    head += constants
    rows += [np.full(len(motion.time), value) for value in constants.values()]
    lines = (",".join(f"{value:.9g}" for value in row) for row in np.column_stack(rows))
    return "\n".join([",".join(head), *lines]) + "\n"


def read(file: Path, joints: Sequence[str], rate_hz: float, force_limit: float | None = None) -> CellMotion:
    """Read a motion from a .csv or .parquet table, and resample it to `rate_hz` if its own rate differs.

    Positions are interpolated linearly, orientations on the sphere.

    Args:
        file: the table.
        joints: their names, for the columns `q_null.JOINT`.
        rate_hz: ticks of the controller per second.
        force_limit: N, replaces the table's; None to keep that.

    Raises:
        UserError: no such file, a missing column, fewer than ten rows, time that does not increase, an empty cell, a
            quaternion that is not of unit length, a gain or force limit that is not positive, or a gain, force limit or
            posture that changes from row to row.
    """
    if not file.is_file():
        raise UserError("no such motion file", file=file)
    table = read_table(file)
    time, names = table.number("time"), columns_of("ee_cmd", ())
    pose = np.stack([table.number(column) for column in names], axis=1)
    if len(time) < 10 or not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
        raise UserError("not a motion", file=file, key="time", expected="ten strictly increasing times or more")
    check_finite(table, pose, names)
    if np.isnan(pose).any():
        raise UserError("empty cells", file=file, key="ee_cmd", expected="a number in each row")
    check_unit(table, pose[:, 3:], "ee_cmd")
    time = time - time[0]
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    check_length(float(time[-1]), rate_hz, file)
    grid = np.arange(int(np.floor(time[-1] * rate_hz + 1e-6)) + 1) / rate_hz
    if len(grid) != len(time) or np.any(np.abs(grid - time) > 1e-3 / rate_hz):
        pose = _resampled(time, pose, grid)
    gains, limit = _constant(table, GAINS, "two gains > 0, 1/s^2"), _constant(table, (LIMIT,), "a force > 0, N")
    for values, names in ((gains, GAINS), (limit, (LIMIT,))):
        if values is not None and not (values > 0).all():
            raise UserError("not positive", file=file, key=names[0], expected="a number > 0", got=values.tolist())
    if force_limit is None and limit is not None:
        force_limit = float(limit[0])
    stiffness = None if gains is None else (float(gains[0]), float(gains[1]))
    posture = _constant(table, columns_of(NULL, joints), "one posture for all rows, rad")
    return CellMotion(file.stem, grid, pose, force_limit, stiffness, posture)


def _constant(table: Table, names: Sequence[str], expected: str) -> np.ndarray | None:
    """Return the values (len(names),) of constant columns; None if the table has no column of their kind.

    Raises:
        UserError: only some of the columns exist, or their values change from row to row.
    """
    kind = names[0].partition(".")[0]
    if not any(name.partition(".")[0] == kind for name in table.names):
        return None
    values = np.stack([table.number(name) for name in names], axis=1)
    if not np.all(values == values[0]):
        raise UserError("is not constant", file=table.file, key=kind, expected=f"{expected}, the same on all rows")
    return values[0]


def _resampled(time: np.ndarray, pose: np.ndarray, grid: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation, Slerp

    turns = Slerp(time, Rotation.from_quat(pose[:, 3:], scalar_first=True))(np.clip(grid, time[0], time[-1]))
    place = np.stack([np.interp(grid, time, column) for column in pose[:, :3].T], axis=1)
    return np.concatenate([place, turns.as_quat(scalar_first=True)], axis=1)
