"""Commanded motions from a table, proposed by a diagnosis or written by a person."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from vispeg.core.errors import UserError
from vispeg.identify.excitation import Motion
from vispeg.recordings.columns import columns_of
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.validate import check_length
from vispeg.robots.model import RobotModel


def replay(file: Path, robot: RobotModel, rate_hz: float) -> Motion:
    """Return the motion in a .csv or .parquet table, resampled to `rate_hz` by cubic splines if its clock differs.

    Columns: `time` (s), `q_cmd.<joint>` (rad), and `dq_cmd.<joint>` (rad/s; the spline's slope where absent).

    Raises:
        UserError: a column is missing, time does not increase, a command is missing or outside the joint's range, or
            the motion is too long.
    """
    if not file.is_file():
        raise UserError("no such motion file", file=file)
    table = read_table(file)
    time = table.number("time")
    q = np.stack([table.number(c) for c in columns_of("q_cmd", robot.joints)], axis=1)
    if len(time) < 10 or not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
        raise UserError("not a motion", file=file, key="time", expected="ten strictly increasing times or more")
    if not np.isfinite(q).all():
        raise UserError("empty cells", file=file, key="q_cmd", expected="a number for each joint and sample")
    outside = (q < robot.range[:, 0]) | (q > robot.range[:, 1])
    if outside.any():
        j = int(np.flatnonzero(outside.any(axis=0))[0])
        low, high = robot.range[j]
        worst = float(q[np.flatnonzero(outside[:, j])[0], j])
        column = columns_of("q_cmd", robot.joints)[j]
        expected = f"{low:g} to {high:g} rad"
        raise UserError("outside the joint's range", file=file, key=column, expected=expected, got=worst)
    time = time - time[0]
    spline = CubicSpline(time, q)
    rates = columns_of("dq_cmd", robot.joints)
    present = all(c in table.columns for c in rates)
    dq = np.stack([table.number(c) for c in rates], axis=1) if present else spline(time, 1)
    if not np.isfinite(dq).all():
        raise UserError(
            "empty cells", file=file, key="dq_cmd", expected="a number for each joint and sample, or no column"
        )
    check_length(float(time[-1]), rate_hz, file)
    grid = np.arange(int(np.floor(time[-1] * rate_hz + 1e-6)) + 1) / rate_hz
    if len(grid) == len(time) and np.all(np.abs(grid - time) < 1e-3 / rate_hz):
        return Motion(file.stem, grid, q, dq)
    return Motion(file.stem, grid, spline(grid), spline(grid, 1) if not present else CubicSpline(time, dq)(grid))
