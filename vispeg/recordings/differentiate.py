"""Velocity and acceleration from measured angles, without shifting them in time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

CUTOFF_HZ = 15.0  # bandwidth of an arm's motion, of which speeds and accelerations are taken
ORDER = 4  # of the Butterworth filter, which runs forwards and backwards: gain 1 / (1 + (f/fc)^8), no phase
SETTLE = 20  # an edge is extended by SETTLE / (cutoff / Nyquist frequency) samples: transients decay below 1e-9 there
GAP_S = 0.020  # s: longer gaps are not interpolated
UNEVEN = 1e-3  # jitter, in sample periods, beyond which samples are resampled to an even grid before filtering
BLOCK = 1 << 18  # samples filtered at once; longer runs are filtered in overlapping blocks to save memory
FINER = 4  # the finest even grid, as a multiple of the mean rate
SPLINE = 200  # samples over which the influence of a spline's end decays


def smooth(
    time: np.ndarray, q: np.ndarray, cutoff_hz: float, episode: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Low-pass q without phase shift, and return it with its first two derivatives.

    Samples are filtered by a Butterworth low-pass run forwards and backwards over an odd extension of either edge, then
    a quintic spline through the result is differentiated. No filter runs across the border of two episodes. Missing
    readings of up to 20 ms are bridged by a spline; longer gaps split the signal and stay NaN.

    Args:
        time: (n,) s, increasing within an episode; need not be even.
        q: (n, nj) rad, NaN where missing.
        cutoff_hz: -3 dB (both passes together: -6 dB) frequency; at or above 0.45 of the sample rate nothing is cut.
        episode: as in `episodes`.

    Returns:
        q (rad), dq (rad/s), ddq (rad/s^2), each (n, nj); derivatives are NaN at a lone reading.
    """
    time, q = np.asarray(time, float), np.asarray(q, float)
    out = tuple(np.full(q.shape, np.nan) for _ in range(3))
    for rows in episodes(time, episode):
        for columns in _same_gaps(np.isfinite(q[rows])):
            good = rows[np.isfinite(q[rows, columns[0]])]
            for run in _runs(time, good):
                inside = rows[(rows >= run[0]) & (rows <= run[-1])]
                for block, at in _blocks(time, run, inside, cutoff_hz):
                    parts = _smooth_run(time[block], q[np.ix_(block, columns)], time[at], cutoff_hz)
                    for full, part in zip(out, parts, strict=True):
                        full[np.ix_(at, columns)] = part
    return out[0], out[1], out[2]


def bridged(time: np.ndarray, values: np.ndarray, episode: np.ndarray | None = None) -> np.ndarray:
    """Interpolate missing values (n, k) at times (n,) s linearly, each of the `episodes` by itself.

    A column without any reading in an episode stays NaN there.
    """
    out = np.array(values, float)
    for rows in episodes(time, episode) if not np.isfinite(out).all() else ():
        for k in range(out.shape[1]):
            bad = ~np.isfinite(out[rows, k])
            if bad.any() and not bad.all():
                out[rows[bad], k] = np.interp(time[rows[bad]], time[rows[~bad]], out[rows[~bad], k])
    return out


def episodes(time: np.ndarray, episode: np.ndarray | None = None) -> list[np.ndarray]:
    """Return the row numbers of each stretch over which `time` (n,) never steps back and `episode` (n,) stays the same.

    Without `episode`, as time may go on from one to the next, episodes are separated only where time steps back.
    """
    new = np.diff(time) < 0
    if episode is not None:
        new |= np.diff(episode) != 0
    return [rows for rows in np.split(np.arange(len(time)), np.flatnonzero(new) + 1) if len(rows)]


def differences(time: np.ndarray, values: np.ndarray, episode: np.ndarray | None = None) -> np.ndarray:
    """Return the central differences of readings (n, k) over time (n,) s, each of the `episodes` by itself.

    A missing reading is NaN, and those beside it are differentiated across it; a lone reading does not move.
    """
    out = np.where(np.isfinite(values), 0.0, np.nan)
    for rows in episodes(time, episode):
        for k in range(values.shape[1]):
            read = rows[np.isfinite(values[rows, k])]
            if len(read) > 1:
                out[read, k] = np.gradient(values[read, k], time[read])
    return out


def spanned(time: np.ndarray, episode: np.ndarray | None) -> float:
    """Return the time that samples (n,) span, s: the sum over their `episodes`."""
    return float(sum(np.ptp(time[rows]) for rows in episodes(time, episode)))


def usual_rate(time: np.ndarray, runs: Sequence[np.ndarray], span: float = 1.0) -> float:
    """Return the usual number of samples per second, from the times (n,) s alone.

    It is the median over stretches of `span` s, so that neither gaps nor rows written in bursts change it.

    Args:
        time: (n,) s.
        runs: row numbers of each stretch over which time never steps back, as `episodes` returns them.
        span: s; a shorter run counts as one stretch.
    """
    rates: list[float] = []
    for at in (time[rows] for rows in runs if len(rows) > 1):
        edges = np.arange(at[0], at[-1], span)
        rates += list(np.diff(np.searchsorted(at, edges)) / span) or [(len(at) - 1) / float(at[-1] - at[0])]
    return float(np.median([rate for rate in rates if rate > 0])) if any(rates) else 1.0 / span


def _blocks(
    time: np.ndarray, run: np.ndarray, inside: np.ndarray, cutoff_hz: float
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Split a run of rows into overlapping pieces to filter; yield each with the rows of `inside` to take from it.

    A piece extends so far beyond these rows at both ends that transients of the filter and of the spline decay there.
    """
    if len(run) <= BLOCK:
        yield run, inside
        return
    period = float(np.median(np.diff(time[run[:BLOCK]])))
    margin = SPLINE + int(min(np.ceil(SETTLE / max(2 * cutoff_hz * period, 1e-9)), BLOCK))
    for start in range(0, len(run), BLOCK):
        stop = min(start + BLOCK, len(run))
        first, last = run[start], (run[stop] if stop < len(run) else run[-1] + 1)
        yield run[max(start - margin, 0) : stop + margin], inside[(inside >= first) & (inside < last)]


def _same_gaps(finite: np.ndarray) -> Iterator[np.ndarray]:
    """Group the columns of (n, nj) that miss the same readings, so that each group is filtered in one call."""
    if finite.all():
        yield np.arange(finite.shape[1])
        return
    masks, group = np.unique(finite, axis=1, return_inverse=True)
    for index in range(masks.shape[1]):
        if masks[:, index].any():
            yield np.flatnonzero(group.ravel() == index)


def _runs(time: np.ndarray, good: np.ndarray) -> list[np.ndarray]:
    """Return the rows with a reading, split where the next one is more than 20 ms and 1.5 usual steps later."""
    step = np.diff(time[good])
    longest = max(GAP_S, 1.5 * float(np.median(step))) if len(step) else GAP_S
    return np.split(good, np.flatnonzero(step > longest * (1 + 1e-9)) + 1)


def _smooth_run(time: np.ndarray, q: np.ndarray, at: np.ndarray, cutoff_hz: float) -> list[np.ndarray]:
    """Smooth samples (n, k) without gaps; return value, first and second derivative at the times `at`."""
    from scipy.interpolate import make_interp_spline
    from scipy.signal import butter, sosfiltfilt

    if len(time) < 2:
        return [np.repeat(q, len(at), axis=0), *np.full((2, len(at), q.shape[1]), np.nan)]
    start, time, at = time[0], time - time[0], at - time[0]  # small numbers keep the splines well conditioned
    # a logger that writes in bursts has a median step far below the mean: a finer grid would add no information
    dt = max(float(np.median(np.diff(time))), time[-1] / (FINER * len(time)))
    grid = np.linspace(0.0, time[-1], max(int(round(time[-1] / dt)) + 1, 2))
    if len(grid) != len(time) or np.max(np.abs(grid - time)) > UNEVEN * dt + 1e-12 * abs(start):
        q = make_interp_spline(time, q, k=min(3, len(time) - 1))(grid)
    fraction = 2 * cutoff_hz * (grid[1] - grid[0])
    if fraction < 0.9 and len(grid) > 6:
        pad = int(min(np.ceil(SETTLE / fraction), BLOCK))  # with time in a wrong unit it would be 1e9 samples
        longer = np.pad(q, ((pad, pad), (0, 0)), mode="reflect", reflect_type="odd")  # sosfiltfilt pads n - 1 at most
        q = sosfiltfilt(butter(ORDER, fraction, output="sos"), longer, axis=0, padtype=None)[pad:-pad]
    degree = min(5, len(grid) - 1)
    spline = make_interp_spline(grid, q, k=degree)
    return [spline(at, nu=nu) if nu <= degree else np.zeros((len(at), q.shape[1])) for nu in range(3)]
