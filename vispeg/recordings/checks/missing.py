"""Handle missing readings: how many are allowed, where a motion is split at them, and how they are reported."""

from __future__ import annotations

import numpy as np

from vispeg.recordings.checks.quality import runs
from vispeg.recordings.columns import NEEDED, columns_of
from vispeg.recordings.differentiate import episodes, usual_rate
from vispeg.recordings.recording import Recording

MOST = 0.2  # largest share of missing readings in a needed column: beyond it, interpolation shapes the result
STIFF = ("position", "servo")  # control modes whose loop forgets its initial state within about 0.1 s
LONG, PERIODS = 0.1, 3.5  # s, and sample periods: the motion in a gap longer than both is unknown


def longest(missing: np.ndarray) -> tuple[int, int]:
    """Return (first, stop) of the longest run of True in (n,); (0, 0) if there is none."""
    return max(runs(missing), key=lambda run: run[1] - run[0], default=(0, 0))


def stretches(rec: Recording, rows: np.ndarray) -> list[np.ndarray]:
    """Split the rows of one episode where rows, or a simulation's inputs, are missing for over `LONG` and `PERIODS`.

    The inputs are the commands and, unless the control loop is stiff, the angles: interpolation across a long gap is
    not the motion. Each stretch begins where every joint has a reading, as a simulation starts from these.
    """
    least = _long(rec, rows)
    signals = [getattr(rec, name) for name in NEEDED[rec.control.mode]]
    signals += [] if rec.control.mode in STIFF else [rec.q]
    columns = [column for signal in signals if signal is not None for column in signal.T]
    out = []
    for part in np.split(rows, _lost(rec, rows, least) + 1):
        time, cut = rec.time[part], np.zeros(len(part), bool)
        for column in columns:
            for first, stop in runs(~np.isfinite(column[part])):
                cut[first:stop] |= time[min(stop, len(part) - 1)] - time[max(first - 1, 0)] > least
        begun = [(part[a:b], _begun(np.isfinite(rec.q[part[a:b]]), time[a:b], least)) for a, b in runs(~cut)]
        out += [piece[first:] for piece, first in begun if first is not None]
    return out


def _long(rec: Recording, rows: np.ndarray) -> float:
    """Return the time, s, beyond which the motion between two of these rows is unknown."""
    return max(LONG, PERIODS / usual_rate(rec.time, [rows]))


def _lost(rec: Recording, rows: np.ndarray, least: float) -> np.ndarray:
    """Return the indices of the rows after which the next one comes more than `least` s later."""
    return np.flatnonzero(np.diff(rec.time[rows]) > least)


def _begun(read: np.ndarray, time: np.ndarray, least: float) -> int | None:
    """Return the row by which every joint has been read, or a row with all joints read if one follows in `least` s.

    `read` (n, nj) marks the readings; None if some joint is never read.
    """
    if not read.any(axis=0).all():
        return None
    first = int(read.argmax(axis=0).max())
    full = first + int(read[first:].all(axis=1).argmax())
    return full if read[full].all() and time[full] - time[first] <= least else first


def said(rec: Recording) -> list[str]:
    """Word what is missing of the signals that a comparison uses: lines on readings, bad readings, and rows."""
    parts = [part for name in compared(rec) if (part := _missing(rec, name))]
    out = [f"{rec.name}: missing: {'; '.join(parts)}; readings are left out, commands bridged"] if parts else []
    if rec.bad is not None and rec.bad.any():
        which = ", ".join(joint for joint, bad in zip(rec.joints, rec.bad.T, strict=True) if bad.any())
        many = "one angle jumps" if rec.bad.sum() == 1 else f"{rec.bad.sum()} angles jump"
        first = rec.elapsed[rec.bad.any(axis=1).argmax()]
        out.append(f"{rec.name}: {many} away and back ({which}; the first at {first:.6g} s): left out")
    if rec.held is not None and rec.held.any():
        share = f"{100 * rec.held.mean():.2g} % of the rows"
        out.append(f"{rec.name}: {share} repeat the angles of an earlier one: not compared, as they are late")
    ends = [rows[k] for rows in episodes(rec.time, rec.episode) for k in _lost(rec, rows, _long(rec, rows))]
    if ends:
        worst = max(ends, key=lambda k: rec.time[k + 1] - rec.time[k])
        which = "for" if len(ends) == 1 else f"{len(ends)} times, the longest for"
        where = f"{which} {rec.time[worst + 1] - rec.time[worst]:.3g} s from {rec.elapsed[worst]:.6g} s on"
        out.append(f"{rec.name}: no rows {where}; what is before and after is simulated separately")
    return out


def compared(rec: Recording) -> tuple[str, ...]:
    """Return the signals that a comparison of this recording uses."""
    torque = ("tau",) if rec.torque_sensor != "none" else ()
    load = ("load",) if rec.control.mode == "servo" else ()
    wrench = ("ft",) if rec.wrench is not None or rec.cell is not None else ()
    return ("q", *NEEDED[rec.control.mode], *torque, *load, *wrench)


def _missing(rec: Recording, name: str) -> str:
    """Word how much of a signal is missing in its worst column; "" if nothing is."""
    values = getattr(rec, name)
    if values is None:
        return ""
    lost = np.isnan(values) & ~rec.bad if name == "q" and rec.bad is not None else np.isnan(values)
    if not lost.any():
        return ""
    j = int(np.argmax(lost.mean(axis=0)))
    spans = [(rows[0], *longest(lost[rows, j])) for rows in episodes(rec.time, rec.episode)]
    start, first, stop = max(spans, key=lambda span: span[2] - span[1])
    first, last = start + first, start + stop - 1
    where = f"at most {last - first + 1} in a row, from {rec.elapsed[first]:.6g} s on"
    others = int(lost.any(axis=0).sum()) - 1
    also = f" and at most as much of {others} more" if others else ""
    return f"{lost[:, j].mean():.1%} of {columns_of(name, rec.joints)[j]} ({where}){also}"
