"""Recover encoder ticks from normalised angles: LeRobot writes -100 to 100 over each joint's calibrated range.

A reading is a whole number of ticks, so normalised values differ by whole multiples of 200 / range (for a gripper in
per cent, 100 / range). The calibrated range is the smallest range for which all differences are such multiples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.json_data import read_json

TICKS = 4096  # ticks per turn of Feetech's STS3215 and Dynamixel's X series
FULL = 100.5  # largest normalised value: 100, and rounding may put a goal slightly beyond
LEAST_RANGE = 64  # ticks (6 degrees): no joint has a smaller calibrated range
NEAR = 1e-2  # ticks, tolerance of a whole number: float32 resolves a value of 100 to 2e-4 ticks
DISTINCT = 12  # least number of distinct values: so many lie on a grid within NEAR by chance once in 1e20
STEPS = (360 / 4096, 360 / 4095)  # degrees per tick, as LeRobot's use_degrees writes them
GRIPPERS = {"gripper", "jaw", "hand", "finger", "claw", "grip"}


@dataclass(frozen=True)
class Decoded:
    """Conversion of a column's normalised values to ticks of 2 pi / 4096 rad.

    Attributes:
        span: calibrated range, ticks.
        full: width of the range in normalised units, 200 or 100.
        sure: whether the range was found in the values or read from a calibration file (else it is a guess).
        values: number of distinct values it was found in; 0 if read from a file.
    """

    span: int
    full: int
    sure: bool
    values: int = 0

    @property
    def scale(self) -> float:
        """Ticks per normalised unit."""
        return self.span / self.full


def span_of(values: np.ndarray, full: float) -> int | None:
    """Return the smallest range in ticks for which all values (n,) are whole ticks; None if there is none. The range
    is `full` wide in the values' unit.
    """
    distinct = np.unique(values[np.isfinite(values)])
    if len(distinct) < DISTINCT:
        return None
    share = (distinct - distinct[0]) / full
    spans = np.arange(LEAST_RANGE, TICKS + 1)
    for part in np.array_split(spans, 16):
        ticks = share[:, None] * part
        good = np.flatnonzero(np.abs(ticks - np.round(ticks)).max(axis=0) < NEAR)
        if len(good):
            return int(part[good[0]])
    return None


def decoded(
    stack: np.ndarray, names: Sequence[str], calibration: Mapping[str, int] | None = None
) -> list[Decoded | None]:
    """Return how each column (n, nj) converts to ticks; None for columns that are not normalised, or for all of them.

    Args:
        stack: measured values as they are in the file.
        names: joint names, as in the file or the model.
        calibration: joint -> calibrated range, ticks.

    Returns:
        One entry per column. All are None if a value exceeds 100, if all joints share one step (degrees, or rounded
        decimals), or if no column consists of whole ticks and no calibration is given.
    """
    none: list[Decoded | None] = [None] * len(names)
    if not stack.size or float(np.nanmax(np.abs(stack))) > FULL:
        return none
    fulls = [100 if GRIPPERS & set(_words(name)) and np.nanmin(column) >= -0.5 else 200
             for name, column in zip(names, stack.T, strict=True)]  # fmt: skip
    found = [span_of(column, full) for column, full in zip(stack.T, fulls, strict=True)]
    calibrated = [None if calibration is None else _calibrated(name, calibration) for name in names]
    steps = {round(full / span, 9) for span, full in zip(found, fulls, strict=True) if span is not None}
    if not any(calibrated) and (not steps or len(steps) == 1 and sum(span is not None for span in found) > 1):
        return none
    if not any(calibrated) and all(_decimal(step) for step in steps):
        return none
    out = [*none]
    for j, (span, full, stated) in enumerate(zip(found, fulls, calibrated, strict=True)):
        distinct = len(np.unique(stack[:, j]))
        if stated is not None and (span is None or stated % span == 0):
            out[j] = Decoded(stated, full, True, distinct if span is not None else 0)
        elif span is not None:
            out[j] = Decoded(span, full, stated is None, distinct)
        else:  # at rest or hardly moving: assume that its range is about as wide as the other joints'
            usual = [s * 200 // f for s, f in zip(found, fulls, strict=True) if s is not None]
            out[j] = Decoded(int(np.median(usual)) * full // 200, full, False)
    return out


def step_of_degrees(stack: np.ndarray) -> float | None:
    """Return the degrees per tick in which all columns (n, nj) are whole ticks; None if no known step fits."""
    for step in STEPS:
        columns = [np.unique(column[np.isfinite(column)]) for column in stack.T]
        ticks = [(column - column[0]) / step for column in columns if len(column) >= DISTINCT]
        if ticks and all(np.abs(t - np.round(t)).max() < NEAR for t in ticks):
            return step
    return None


def read_calibration(file: Path) -> dict[str, int]:
    """Read joint -> calibrated range, ticks, from LeRobot's calibration file. Raises UserError: not such a file."""
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
    """Find `calibration.json` in a data set's folder or its `meta` folder; None if there is none."""
    folders = [source, *source.resolve().parents[:3]] if source.is_dir() else [*source.resolve().parents[:4]]
    return next(
        (f / n for f in folders for n in ("calibration.json", "meta/calibration.json") if (f / n).is_file()), None
    )


def _calibrated(name: str, calibration: Mapping[str, int]) -> int | None:
    """Return the calibrated range of the motor whose name matches a column's label or joint; None without a match."""
    called = {"_".join(word for word in _words(part) if word != "joint") for part in name.split(" ")}
    return next((span for key, span in calibration.items() if "_".join(_words(key)) in called), None)


def _words(name: str) -> list[str]:
    return [word for word in "".join(c.lower() if c.isalnum() else " " for c in name).split() if word != "pos"]


def _decimal(step: float) -> bool:
    """Test whether a step is mere decimal rounding, such as 0.1 or 0.05."""
    return any(math.isclose(step * 10**k, round(step * 10**k), rel_tol=1e-6) and round(step * 10**k) for k in range(3))
