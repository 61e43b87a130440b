"""The frequency response of a joint with its coherence, from sines held for whole periods, or from a sweep.

H1 = S_xy / S_xx of the command x and the angle y, by SciPy's `csd` and `coherence`. With m averages and the coherence
g2, the standard uncertainty of the gain (relative) and of the phase (rad) is sqrt((1 - g2) / (2 g2 m)) (Bendat and
Piersol, Random Data, 4th ed., 9.2.4). Frequencies with a coherence below 0.9 are not used: more than a tenth of the
measured power is not caused by the command.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, signal

from vispeg.measure.steps import Servo
from vispeg.measure.trace import PERIODS, Trace, ramps, sines, steps

COHERENT = 0.9  # least coherence of a frequency that is used
PER_PERIOD = 64  # samples per period to which a sine is resampled
AVERAGES, POINTS = 15, 30  # for a sweep: number of overlapping segments, and of frequencies that are kept
POWERED = 1e-3  # least power of the command at a frequency, as a share of its greatest


@dataclass(frozen=True)
class Point:
    """The response at one frequency.

    Attributes:
        hz: frequency.
        amplitude: of the command, rad; 0 for a sweep.
        response: H, complex.
        coherence: 0 to 1.
        averages: number of independent averages.
    """

    hz: float
    amplitude: float
    response: complex
    coherence: float
    averages: int

    @property
    def used(self) -> bool:
        """Whether the coherence is high enough."""
        return self.coherence >= COHERENT

    @property
    def u(self) -> float:
        """Standard uncertainty of the gain (relative), and of the phase (rad)."""
        c = min(max(self.coherence, 1e-9), 1.0)
        return float(np.sqrt((1.0 - c) / (2.0 * c * self.averages)))


def points(trace: Trace) -> list[Point]:
    """Return the points of a trace: one per stretch of sine, many for a sweep, none for steps and ramps."""
    held = sines(trace)
    changing = np.abs(np.diff(trace.q_cmd)) > 1e-9
    if sum(period * count for _, period, _, count in held) > 0.4 * changing.mean() * np.ptp(trace.time):
        return [_sine(trace, *stretch) for stretch in held]
    straight = sum(b - a for a, b, _ in ramps(trace)) / len(trace.time)
    return _sweep(trace) if changing.mean() > 0.9 and straight < 0.3 and not steps(trace) else []


def _sine(trace: Trace, start: float, period: float, amplitude: float, count: int) -> Point:
    if count > PERIODS:  # skip the first period, in which the transient dies away
        start, count = start + period, count - 1
    grid = start + np.arange(count * PER_PERIOD) * period / PER_PERIOD
    x, y = np.interp(grid, trace.time, trace.q_cmd), np.interp(grid, trace.time, trace.q)
    how = {"fs": PER_PERIOD / period, "window": "boxcar", "nperseg": PER_PERIOD, "noverlap": 0}
    f, sxy = signal.csd(x, y, **how)
    sxx, syy = signal.welch(x, **how)[1], signal.welch(y, **how)[1]
    coherence = float(np.abs(sxy[1]) ** 2 / max(float(sxx[1] * syy[1]), 1e-300))
    return Point(float(f[1]), amplitude, complex(sxy[1] / sxx[1]), coherence, count)


def _sweep(trace: Trace) -> list[Point]:
    rate = 1.0 / trace.period
    grid = np.arange(trace.time[0], trace.time[-1], trace.period)
    x, y = np.interp(grid, trace.time, trace.q_cmd), np.interp(grid, trace.time, trace.q)
    how = {"fs": rate, "nperseg": 2 * len(grid) // (AVERAGES + 1), "detrend": "constant"}
    f, sxy = signal.csd(x, y, **how)
    sxx, coherence = signal.welch(x, **how)[1], signal.coherence(x, y, **how)[1]
    use = np.flatnonzero((sxx > POWERED * sxx.max()) & (f > 0))
    if not len(use):
        return []
    # not every bin, as neighbours share their data; evenly spaced on a logarithmic scale
    goal = np.geomspace(f[use[0]], f[use[-1]], POINTS)
    pick = np.unique(use[np.abs(f[use][:, None] - goal).argmin(axis=0)])
    # segments overlap by half, so about half of them are independent
    return [Point(float(f[k]), 0.0, complex(sxy[k] / sxx[k]), float(coherence[k]), AVERAGES // 2) for k in pick]


def bandwidth(points: list[Point]) -> tuple[float, float, float] | None:
    """Return the frequency at which the gain is 3 dB below that at rest; None if it never is.

    It is the bandwidth of the second-order servo through the points, if there are enough. Else it is interpolated
    between the two points on either side, and its uncertainty includes their distance.

    Returns:
        Frequency in Hz, its standard uncertainty in Hz, degrees of freedom.
    """
    used: list[list[Point]] = []  # groups of one frequency each, within 2 %
    for p in sorted((p for p in points if p.used), key=lambda p: p.hz):
        if used and p.hz < 1.02 * used[-1][0].hz:
            used[-1].append(p)
        else:
            used.append([p])
    if len(used) < 2:
        return None
    gain = np.array([np.mean([abs(p.response) for p in same]) for same in used])
    spread = [max([p.u for p in same] + [float(np.ptp([abs(p.response) for p in same])) / 2]) for same in used]
    gain = gain / gain[0]
    f, end = np.log([same[0].hz for same in used]), 1.0 / np.sqrt(2.0)
    below = np.flatnonzero(gain < end)
    if not len(below) or below[0] == 0:
        return None
    k = int(below[0])
    fitted = fit(points)
    if fitted is not None:
        servo, covariance, dof = fitted
        nearby = Servo(servo.gain, servo.natural_frequency, servo.damping_ratio * (1 + 1e-4), servo.delay)
        # derivatives with respect to ln wn and ln zeta; the bandwidth is proportional to wn
        way = servo.bandwidth_hz * np.array([1.0, np.log(nearby.bandwidth_hz / servo.bandwidth_hz) / 1e-4])
        return servo.bandwidth_hz, float(np.sqrt(way @ covariance[1:3, 1:3] @ way)), float(dof)
    slope = (gain[k] - gain[k - 1]) / (f[k] - f[k - 1])
    at = float(np.exp(f[k - 1] + (end - gain[k - 1]) / slope))
    u = end * np.hypot(max(spread[k], spread[k - 1]), spread[0])
    between = (np.exp(f[k]) - np.exp(f[k - 1])) / np.sqrt(12.0)
    return at, float(np.hypot(at * u / max(abs(slope), 1e-9), between)), np.inf


def fit(points: list[Point]) -> tuple[Servo, np.ndarray, int] | None:
    """Fit a second-order servo to the coherent points; None if there are fewer than four.

    Returns:
        The servo, the covariance (4, 4) of K, ln wn, ln zeta and the delay, and the degrees of freedom.
    """
    used = [p for p in points if p.used]
    if len(used) < 4:
        return None
    f, h = np.array([p.hz for p in used]), np.array([p.response for p in used])
    weight = 1.0 / np.array([max(p.u, 0.01) * abs(p.response) for p in used])

    def residual(x: np.ndarray) -> np.ndarray:
        miss = weight * (Servo(x[0], np.exp(x[1]), np.exp(x[2]), x[3]).response(f) - h)
        return np.concatenate([miss.real, miss.imag])

    low, high = [0.0, np.log(0.5), np.log(0.02), 0.0], [3.0, np.log(2000.0), np.log(20.0), 0.3]
    best = None
    for hz in (0.5 * f.max(), f.max(), 3.0 * f.max()):
        x0 = [abs(h[np.argmin(f)]), np.log(2 * np.pi * hz), np.log(0.7), 0.005]
        solution = optimize.least_squares(
            residual, np.clip(x0, low, high), bounds=(low, high), x_scale=[0.1, 0.3, 0.3, 0.01]
        )
        best = solution if best is None or solution.cost < best.cost else best
    assert best is not None
    dof = 2 * len(used) - 4
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * 2.0 * best.cost / dof
    servo = Servo(float(best.x[0]), float(np.exp(best.x[1])), float(np.exp(best.x[2])), float(best.x[3]))
    return servo, covariance, dof
