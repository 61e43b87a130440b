"""Check the values of a recording. Each check raises a UserError that names the row and the column."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.checks.missing import MOST, longest
from vispeg.recordings.tables.table import Table

MAX_ANGLE = 4 * np.pi  # rad: larger angles must be degrees, as no arm turns so far
UNIT_TOLERANCE = 1e-2  # of a quaternion's norm: rounding to three digits passes, other columns in its place do not
MOST_SAMPLES = 1_000_000  # half an hour at 500 Hz, to bound memory
CLOCKS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}


def check_finite(table: Table, values: np.ndarray, columns: list[str]) -> None:
    """Refuse infinite values in (n, k); NaN is a missing reading and passes."""
    place = _first(values, np.isinf)
    if place is not None:
        row, column = place
        raise UserError("is infinite", file=table.file, key=f"{table.row(row)}, {table.column(columns[column])}")


def _first(values: np.ndarray, wrong: Callable[[np.ndarray], np.ndarray]) -> tuple[int, int] | None:
    """Return (row, column) of the first wrong value in (n, k), testing one column at a time to save memory."""
    places = [(int(np.argmax(bad)), j) for j, column in enumerate(values.T) if (bad := wrong(column)).any()]
    return min(places, default=None)


def check_length(seconds: float, rate_hz: float, file: Path | None = None) -> None:
    """Refuse a motion at an impossible rate, of fewer than ten samples, or of more than MOST_SAMPLES.

    It has one sample more if its table is `file`, from the first row to the last.
    """
    count, said = seconds * rate_hz, f"{seconds:g} s at {rate_hz:g} Hz"
    where = {} if file is None else {"file": file, "key": "time"}
    if not (rate_hz > 0.0 and count + (file is not None) > 9.5):  # also refuses nan
        raise UserError("a motion needs ten samples at least", **where, got=said)
    if count > MOST_SAMPLES:
        raise UserError("too long a motion", **where, expected=f"at most {MOST_SAMPLES} samples", got=said)


def check_share(table: Table, values: np.ndarray, columns: list[str]) -> None:
    """Refuse a needed column of which more than the share `MOST` is missing."""
    missing = np.array([np.mean(np.isnan(column)) for column in values.T])
    worst = int(np.argmax(missing))
    if missing[worst] > MOST:
        first, stop = longest(np.isnan(values[:, worst]))
        gap = f"the longest gap is {table.row(first)} to {table.row(stop - 1)}"
        raise UserError(
            f"{missing[worst]:.1%} of the readings are missing ({gap})",
            file=table.file,
            key=table.column(columns[worst]),
            expected=f"at most {MOST:.0%}: cut the recording there, or record it again",
        )


def check_angles(table: Table, values: np.ndarray, columns: list[str]) -> None:
    """Refuse angles (n, nj) beyond two turns in radians, which are probably degrees."""
    place = _first(values, lambda column: np.abs(column) > MAX_ANGLE)
    if place is not None:
        row, column = place
        raise UserError(
            "looks like degrees",
            file=table.file,
            key=f"{table.row(row)}, {table.column(columns[column])}",
            expected="radians, at most two turns",
            got=float(values[row, column]),
        )


def check_unit(table: Table, quaternions: np.ndarray, name: str) -> None:
    """Refuse quaternions (n, 4) whose norm is not 1; rows with a missing component are not checked."""
    with np.errstate(over="ignore"):
        norm = np.linalg.norm(quaternions, axis=1)
    bad = np.flatnonzero(np.abs(norm - 1) > UNIT_TOLERANCE)
    if len(bad):
        raise UserError(
            "quaternion is not of unit length",
            file=table.file,
            key=f"{table.row(bad[0])}, columns {name}.qw ... {name}.qz",
            got=float(norm[bad[0]]),
        )


def check_episodes(table: Table, values: np.ndarray) -> np.ndarray:
    """Convert episode numbers (n,) to int64; they must be whole, complete, and contiguous for each episode."""
    bad = np.flatnonzero(~(np.abs(values) < 2**53) | (np.floor(values) != values))
    if len(bad):
        key = f"{table.row(bad[0])}, column episode"
        raise UserError("is not a whole number", file=table.file, key=key, got=float(values[bad[0]]))
    episode = values.astype(np.int64)
    starts = np.flatnonzero(np.diff(episode, prepend=episode[0] - 1))
    earlier: set[int] = set()
    for row in starts:
        if int(episode[row]) in earlier:
            key = f"{table.row(row)}, column episode"
            raise UserError("episode resumes after another", file=table.file, key=key, got=int(episode[row]))
        earlier.add(int(episode[row]))
    return episode


def check_time(table: Table, time: np.ndarray, episode: np.ndarray | None, rate_hz: float) -> None:
    """Refuse times (n,) that are not finite, not strictly increasing within an episode, or not in seconds."""
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        raise UserError("is missing or infinite", file=table.file, key=f"{table.row(bad[0])}, {table.column('time')}")
    if len(time) < 2:
        raise UserError("holds a single sample", file=table.file, expected="a motion")
    step = np.diff(time)
    inside = np.ones(len(step), bool) if episode is None else np.diff(episode) == 0
    back = np.flatnonzero(inside & (step <= 0))
    if len(back):
        row = int(back[0]) + 1
        raise UserError(
            "time does not increase" + ("" if episode is not None else " (several runs need an `episode` column)"),
            file=table.file,
            key=f"{table.row(row)}, column time",
            expected=f"more than {float(time[row - 1])!r}",
            got=float(time[row]),
        )
    if inside.any():
        _check_clock(table, float(np.median(step[inside])) * rate_hz, rate_hz)


def _check_clock(table: Table, ratio: float, rate_hz: float) -> None:
    """Check `ratio`, the median sample period over the stated one; near a power of 1000 the time's unit is wrong."""
    for factor, unit in CLOCKS.items():
        if 0.3 * factor < ratio < 3 * factor:
            raise UserError(f"looks like {unit}", file=table.file, key="column time", expected="seconds")
    if not 0.02 < ratio < 50:
        raise UserError(
            "does not fit `rate_hz` by far",
            file=table.file,
            key="column time",
            expected=f"about {rate_hz:g} samples a second",
            got=round(rate_hz / ratio, 6) if ratio else None,
        )
