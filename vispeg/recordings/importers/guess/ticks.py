"""Finds the encoder ticks in angles that a program has scaled: LeRobot's -100 to 100 of each joint's calibrated range.

A reading is a whole number of ticks, so its normalised values differ by whole multiples of 200 / range (of a gripper in
per cent, 100 / range), and the smallest range for which they all do is the calibrated one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.json_data import read_json

TICKS = 4096  # a turn, of Feetech's STS3215 and Dynamixel's X series
FULL = 100.5  # normalised values end at 100; a goal may pass it by a rounding
LEAST_RANGE = 64  # ticks (6 degrees): no joint is calibrated to less
NEAR = 1e-2  # of a tick: float32 keeps a value of 100 to 2e-4 of one
DISTINCT = 12  # values that differ: by chance this many lie on a grid within NEAR once in 1e20
STEPS = (360 / 4096, 360 / 4095)  # degrees: what LeRobot's use_degrees writes for a tick
GRIPPERS = {"gripper", "jaw", "hand", "finger", "claw", "grip"}


@dataclass(frozen=True)
class Decoded:
    """How a column's values become angles: ticks of 2 pi / 4096 rad for each of its units.

    Attributes:
        span: calibrated range, ticks.
        full: values from one end of it to the other, 200 or 100.
        sure: whether it was found in the values, or read in a calibration file.
        values: distinct values that decided; 0 where a file did.
    """

    span: int
    full: int
    sure: bool
    values: int = 0

    @property
    def scale(self) -> float:
        """Ticks a unit."""
        return self.span / self.full


def span_of(values: np.ndarray, full: float) -> int | None:
    """Give the fewest ticks of which all values (n,) are whole numbers, where `full` is the whole range; None for
    none.
    """
    distinct = np.unique(values[np.isfinite(values)])
    if len(distinct) < DISTINCT:
        return None
    share = (distinct - distinct[0]) / full
    spans = np.arange(LEAST_RANGE, TICKS + 1)
    for some in np.array_split(spans, 16):
        ticks = share[:, None] * some
        good = np.flatnonzero(np.abs(ticks - np.round(ticks)).max(axis=0) < NEAR)
        if len(good):
            return int(some[good[0]])
    return None


def decoded(
    stack: np.ndarray, names: Sequence[str], calibration: Mapping[str, int] | None = None
) -> list[Decoded | None]:
    """Return the scale that decodes each column (n, nj); None for columns, or the whole log, that are not normalised.

    Args:
        stack: measured values as they are in the file.
        names: of the joints, as the file or the model calls them.
        calibration: joint -> calibrated range, ticks.

    Returns:
        One entry a column. All are None where a value passes 100, where all joints have one step (degrees, or decimals
        that were written), or where no column is a whole number of ticks and no calibration says so.
    """
    none: list[Decoded | None] = [None] * len(names)
    if not stack.size or float(np.nanmax(np.abs(stack))) > FULL:
        return none
    fulls = [100 if GRIPPERS & set(_words(name)) and np.nanmin(column) >= -0.5 else 200
             for name, column in zip(names, stack.T, strict=True)]  # fmt: skip
    found = [span_of(column, full) for column, full in zip(stack.T, fulls, strict=True)]
    told = [None if calibration is None else _told(name, calibration) for name in names]
    steps = {round(full / span, 9) for span, full in zip(found, fulls, strict=True) if span is not None}
    if not any(told) and (not steps or len(steps) == 1 and sum(span is not None for span in found) > 1):
        return none
    if not any(told) and all(_decimal(step) for step in steps):
        return none
    out = none
    for j, (span, full, stated) in enumerate(zip(found, fulls, told, strict=True)):
        distinct = len(np.unique(stack[:, j]))
        if stated is not None and (span is None or stated % span == 0):
            out[j] = Decoded(stated, full, True, distinct if span is not None else 0)
        elif span is not None:
            out[j] = Decoded(span, full, stated is None, distinct)
        else:  # it stands, or moves too little: a joint of this kind turns about as far as the others
            usual = [s * 200 // f for s, f in zip(found, fulls, strict=True) if s is not None]
            out[j] = Decoded(int(np.median(usual)) * full // 200, full, False)
    return out


def step_of_degrees(stack: np.ndarray) -> float | None:
    """Give the degrees of a tick that all columns (n, nj) share; None where they share none."""
    for step in STEPS:
        columns = [np.unique(column[np.isfinite(column)]) for column in stack.T]
        ticks = [(column - column[0]) / step for column in columns if len(column) >= DISTINCT]
        if ticks and all(np.abs(t - np.round(t)).max() < NEAR for t in ticks):
            return step
    return None


def read_calibration(file: Path) -> dict[str, int]:
    """Joint -> calibrated range in ticks, of LeRobot's calibration file. Raises UserError: none of that kind."""
    data = read_json(file)
    try:
        out = {str(name): int(motor["range_max"]) - int(motor["range_min"]) for name, motor in data.items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        expected = "motor: {range_min: ticks, range_max: ticks, ...}"
        raise UserError("is no LeRobot calibration", file=file, expected=expected) from error
    for name, span in out.items():
        if not LEAST_RANGE <= span <= TICKS:
            raise UserError("no range of a joint", file=file, key=name, expected=f"{LEAST_RANGE} to {TICKS}", got=span)
    return out


def calibration_beside(source: Path) -> Path | None:
    """`calibration.json` in a data set's folder or its `meta`, where there is one."""
    folders = [source, *source.resolve().parents[:3]] if source.is_dir() else [*source.resolve().parents[:4]]
    return next(
        (f / n for f in folders for n in ("calibration.json", "meta/calibration.json") if (f / n).is_file()), None
    )


def _told(name: str, calibration: Mapping[str, int]) -> int | None:
    """Give the range of the motor that a column's label or its joint is called by."""
    called = {"_".join(word for word in _words(part) if word != "joint") for part in name.split(" ")}
    return next((span for key, span in calibration.items() if "_".join(_words(key)) in called), None)


def _words(name: str) -> list[str]:
    return [word for word in "".join(c.lower() if c.isalnum() else " " for c in name).split() if word != "pos"]


def _decimal(step: float) -> bool:
    """Whether values are only rounded to a step such as 0.1 or 0.05."""
    return any(math.isclose(step * 10**k, round(step * 10**k), rel_tol=1e-6) and round(step * 10**k) for k in range(3))
