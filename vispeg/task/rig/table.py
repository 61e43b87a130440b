"""Commanded flange poses as a table that a robot can replay: time, and the pose column by column.

Where a motion asks for a posture of its own, columns `q_null.JOINT` hold it on each row: the angles (rad) that the arm
begins near and that the null space is pulled to.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.columns import columns_of
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Table
from vispeg.recordings.validate import check_finite, check_unit
from vispeg.task.rig.commanded import CellMotion

NULL = "q_null"


def text(motion: CellMotion, joints: Sequence[str]) -> str:
    """A CSV: `time` (s) and `ee_cmd.x` .. `ee_cmd.qz` (m, w x y z), the flange in the base; `q_null.JOINT` (rad)."""
    head, rows = ["time", *columns_of("ee_cmd", ())], [motion.time, *motion.ee_cmd.T]
    if motion.posture is not None:
        head += columns_of(NULL, joints)
        rows += [np.full(len(motion.time), angle) for angle in motion.posture]
    lines = (",".join(f"{value:.9g}" for value in row) for row in np.column_stack(rows))
    return "\n".join([",".join(head), *lines]) + "\n"


def read(file: Path, joints: Sequence[str], rate_hz: float, force_limit: float | None = None) -> CellMotion:
    """The motion in a .csv or .parquet table, put on a clock of `rate_hz` where its own differs.

    Positions are interpolated linearly, orientations on the sphere; a table at the controller's rate stays as it is.

    Raises:
        UserError: a column is missing, time does not increase, an empty cell, a quaternion that is not of unit length.
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
    grid = np.arange(int(np.floor(time[-1] * rate_hz + 1e-6)) + 1) / rate_hz
    if len(grid) != len(time) or np.any(np.abs(grid - time) > 1e-3 / rate_hz):
        pose = _resampled(time, pose, grid)
    return CellMotion(file.stem, grid, pose, force_limit, posture=_posture(table, joints))


def _posture(table: Table, joints: Sequence[str]) -> np.ndarray | None:
    """(nj,) rad of the columns `q_null.JOINT`; None where there are none.

    Raises:
        UserError: some are missing, or they change.
    """
    names = columns_of(NULL, joints)
    if not any(name.startswith(f"{NULL}.") for name in table.names):
        return None
    angles = np.stack([table.number(name) for name in names], axis=1)
    if not np.all(angles == angles[0]):
        raise UserError("changes", file=table.file, key=f"{NULL}.*", expected="one posture for all rows, rad")
    return angles[0]


def _resampled(time: np.ndarray, pose: np.ndarray, grid: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation, Slerp

    turns = Slerp(time, Rotation.from_quat(pose[:, 3:], scalar_first=True))(np.clip(grid, time[0], time[-1]))
    place = np.stack([np.interp(grid, time, column) for column in pose[:, :3].T], axis=1)
    return np.concatenate([place, turns.as_quat(scalar_first=True)], axis=1)
