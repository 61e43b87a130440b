"""Ramps out and back: friction is the height of the loop of torque over angle, backlash its width at zero torque.

At one measured angle the torques on the way out and back differ by twice the friction, and by the inertia's torque;
gravity cancels. (At one commanded angle gravity would not cancel, because the joint lags in both directions.) When the
teeth of a gear separate, the torque is zero and the motor side turns by the gap until they meet again: this is the
loop's width. A load greater than the friction keeps the teeth on one side, and then no loop shows the gap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vispeg.measure.trace import Trace, angle_noise, strokes

SETTLING = 0.35  # share of each way, from its start, that is left out
WITHIN = 0.5  # share of the commanded speed by which a moving joint's speed may differ; else it starts or sticks
SMOOTH = 0.02  # s, over which the torque is averaged to find the gap
LOAD = 3  # degree of the polynomial in the angle that models gravity within a stroke


@dataclass(frozen=True)
class Stroke:
    """One way out and back. Speed, acceleration, lag and friction are half the difference between the two ways.

    Attributes:
        trace: the recording.
        start: s, time at which the way out begins.
        rows: (k,) rows of the trace that are used; the next stroke may share some.
        shares: (k,) weight of each row's torque in `friction`.
        speed: measured, rad/s.
        acceleration: measured with the same weights, rad/s^2; not 0 if the joint still starts after SETTLING.
        lag: q_cmd - q, rad.
        moves: whether the joint turns at about the commanded speed; otherwise it still starts, or sticks.
        friction: half the torque loop's height, N m; None without a torque that has a sign, or if `moves` is false.
        load: torque in the loop's middle, N m; None as `friction`.
        slope: derivative of the torque with respect to the angle, due to gravity, N m/rad.
        stiffness: derivative of the torque with respect to the lag at the reversal, N m/rad.
        gap: angle turned while the torque passes through zero, rad; None if it does not, or if noise hides it.
    """

    trace: Trace
    start: float
    rows: np.ndarray
    shares: np.ndarray
    speed: float
    acceleration: float
    lag: float
    moves: bool
    friction: float | None = None
    load: float | None = None
    slope: float = 0.0
    stiffness: float = 0.0
    gap: float | None = None


def measured(trace: Trace) -> list[Stroke]:
    """Measure every stroke (out and back) of a trace; too short ones are left out."""
    return [s for out, back, speed in strokes(trace) if (s := _stroke(trace, out, back, speed)) is not None]


def _stroke(trace: Trace, out: tuple[int, int], back: tuple[int, int], speed: float) -> Stroke | None:
    """Measure one stroke, commanded at `speed` rad/s, over the angles that both ways pass; None with too few rows."""
    rows = [np.arange(a, b + 1) for a, b in (out, back)]
    rows = [r[int(SETTLING * len(r)) :] for r in rows]
    low = max(trace.q[r].min() for r in rows)
    high = min(trace.q[r].max() for r in rows)
    inside = [np.flatnonzero((trace.q[r] >= low) & (trace.q[r] <= high)) for r in rows]
    rows = [r[i[0] : i[-1] + 1] if len(i) else r[:0] for r, i in zip(rows, inside, strict=True)]
    if min(len(r) for r in rows) < 9:
        return None
    sign = 1.0 if trace.q_cmd[out[1]] > trace.q_cmd[out[0]] else -1.0
    shares = _shares(trace, rows, sign)
    both = np.concatenate(rows)
    velocity = np.gradient(trace.q, trace.time)
    signals = [velocity, np.gradient(velocity, trace.time), trace.q_cmd - trace.q]
    measured_speed, acceleration, lag = (float(shares[0] @ values[both]) for values in signals)
    # rad/s: 4 standard deviations of the angle's noise over a third of a way
    slack = 4.0 * angle_noise([trace]) / (len(rows[0]) // 3 * trace.period)
    moves = all(abs(abs(v) - speed) <= WITHIN * speed + slack for r in rows for v in _speeds(trace, r))
    stroke = Stroke(trace, float(trace.time[out[0]]), both, shares[0], measured_speed, acceleration, lag, moves)
    if trace.tau is None or not trace.signed() or not moves:
        return stroke
    height, load, slope = (float(share @ trace.tau[both]) for share in shares)
    middle = np.arange(out[0] + (out[1] - out[0]) // 2, back[0] + (back[1] - back[0]) // 2)
    tau = trace.tau[middle]
    gap, stiffness = _gap(trace, tau, middle, sign, height - abs(load)), _stiffness(trace, tau, middle, velocity)
    return replace(
        stroke,
        friction=height,
        load=load,
        slope=slope,
        stiffness=stiffness,
        gap=gap,
    )


def _shares(trace: Trace, rows: list[np.ndarray], sign: float) -> np.ndarray:
    """Return weights (3, nrow) of the rows: for half the loop's height, its middle, and its slope over the angle.

    They are those of a least-squares fit of `height * way + polynomial(q)`, weighted by a Hann window on each way. The
    window and its slope vanish at the ends, so that the same weights also give speed and acceleration from noisy
    numerical derivatives of the angle (modulating functions: Shinbrot, Trans. ASME 79, 1957).
    """
    q = np.concatenate([trace.q[r] for r in rows])
    half = max(0.5 * float(np.ptp(q)), 1e-12)
    x = (q - 0.5 * (q.max() + q.min())) / half
    way = np.repeat([sign, -sign], [len(r) for r in rows])
    window = np.concatenate([np.hanning(len(r) + 2)[1:-1] for r in rows])
    design = np.column_stack([way, np.vander(x, LOAD + 1, increasing=True)])
    shares = np.linalg.lstsq((design.T * window) @ design, design.T * window, rcond=None)[0][:3]
    return shares / np.array([1.0, 1.0, half])[:, None]


def _speeds(trace: Trace, rows: np.ndarray) -> tuple[float, float]:
    """Return the joint's speed in the first and in the last third of these rows, rad/s."""
    t, q, third = trace.time[rows], trace.q[rows], len(rows) // 3
    first, last = (float(np.polyfit(t[p] - t[p][0], q[p], 1)[0]) for p in (slice(0, third), slice(-third, None)))
    return first, last


def _stiffness(trace: Trace, tau: np.ndarray, rows: np.ndarray, velocity: np.ndarray) -> float:
    """Return the slope of the torque over q_cmd - q in these rows, N m/rad, by least squares with a term for speed."""
    lag = trace.q_cmd[rows] - trace.q[rows]
    design = np.column_stack([lag, velocity[rows], np.ones_like(lag)])
    return float(np.linalg.lstsq(design, tau, rcond=None)[0][0])


def _gap(trace: Trace, torque: np.ndarray, middle: np.ndarray, sign: float, top: float) -> float | None:
    """Return the loop's width at zero torque, rad; None if it has none or noise hides it.

    `top`, N m, is the torque on the way on which the load helps: friction less load. The width is extrapolated from
    those between +-1/2 and +-1/4 of `top`, because between such levels the gear also winds up in proportion to them.
    """
    width = max(1, round(SMOOTH / trace.period))
    tau = sign * np.convolve(torque, np.ones(width) / width, "same")
    noise = float(np.std(np.diff(torque))) / np.sqrt(2.0 * width)
    if 0.25 * top < 3.0 * noise:
        return None
    half, quarter = (_between(trace.q[middle], tau, share * top, width) for share in (0.5, 0.25))
    return None if half is None or quarter is None else max(0.0, 2.0 * quarter - half)


def _between(q: np.ndarray, tau: np.ndarray, level: float, width: int) -> float | None:
    """Return the angle turned, rad, from the last row with tau (n,) above `level` to the first row below `-level`.

    None if there are no such rows. Angles are averaged over `width` rows.
    """
    above, below = np.flatnonzero(tau > level), np.flatnonzero(tau < -level)
    below = below[below > above[0]] if len(above) else below[:0]
    if not len(below):
        return None
    end = int(below[0])
    begin = int(above[above < end][-1])
    a, b = (float(np.mean(q[max(0, k - width // 2) : k + width // 2 + 1])) for k in (begin, end))
    return abs(b - a)
