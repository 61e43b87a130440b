"""Ramps out and back: friction as the height of the loop of torque over angle, backlash as its width at no torque.

At one angle the torque out and back differ by twice the friction, whatever gravity does there. Over speeds the halves
lie on tau = tau_c + b v (Coulomb and viscous). Where the teeth of a gear leave each other the torque is zero, and the
motor side turns by the gap until they meet again: the width of the loop there. A load greater than the friction keeps
the teeth on one side, and no loop shows the gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.measure.trace import Trace, strokes

SETTLING = 0.35  # of a stroke after its turn that is left out
WITHIN = 0.5  # of the commanded speed, beyond which a joint still starts or sticks
SMOOTH = 0.02  # s


@dataclass(frozen=True)
class Stroke:
    """One way out and back.

    Attributes:
        trace, start: where and when.
        speed: rad/s.
        friction: half the height of the torque loop, N m; None without a torque that has a sign.
        load: the torque in its middle, N m.
        lag: half of (q_cmd - q) out less back, rad.
        acceleration: half of the mean acceleration out less back, rad/s^2: what is left of the start.
        gap: angle turned while the torque passes zero, rad; None where it does not or there is none.
    """

    trace: str
    start: float
    speed: float
    friction: float | None
    load: float | None
    lag: float
    gap: float | None
    acceleration: float = 0.0


def measured(trace: Trace) -> list[Stroke]:
    """Every out-and-back of a trace."""
    return [s for out, back, speed in strokes(trace) if (s := _stroke(trace, out, back, speed)) is not None]


def _stroke(trace: Trace, out: tuple[int, int], back: tuple[int, int], speed: float) -> Stroke | None:
    rows = [np.arange(a, b + 1) for a, b in (out, back)]
    rows = [r[int(SETTLING * len(r)) :] for r in rows]
    low = max(trace.q_cmd[r].min() for r in rows)
    high = min(trace.q_cmd[r].max() for r in rows)
    rows = [r[(trace.q_cmd[r] >= low) & (trace.q_cmd[r] <= high)] for r in rows]
    if min(len(r) for r in rows) < 9:
        return None
    sign = 1.0 if trace.q_cmd[out[1]] > trace.q_cmd[out[0]] else -1.0
    behind = [float((trace.q_cmd[r] - trace.q[r]).mean()) for r in rows]
    lag = 0.5 * sign * (behind[0] - behind[1])
    start = float(trace.time[out[0]])
    if trace.tau is None or not trace.signed():
        return Stroke(trace.name, start, speed, None, None, lag, None)
    tau = [float(trace.tau[r].mean()) for r in rows]
    motion = [_speeds(trace, r) for r in rows]
    noise = 4.0 * float(np.std(np.diff(trace.q, 2))) / np.sqrt(6.0) / (len(rows[0]) // 3 * trace.period)
    if any(abs(abs(v) - speed) > WITHIN * speed + noise for speeds in motion for v in speeds[:2]):
        return Stroke(trace.name, start, speed, None, None, lag, None)
    friction, load = 0.5 * sign * (tau[0] - tau[1]), 0.5 * (tau[0] + tau[1])
    gap = _gap(trace, out, back, sign, friction, load)
    return Stroke(trace.name, start, speed, friction, load, lag, gap, 0.5 * sign * (motion[0][2] - motion[1][2]))


def _speeds(trace: Trace, rows: np.ndarray) -> tuple[float, float, float]:
    """The joint's speed in the first and in the last third of these rows, rad/s, and its mean acceleration, rad/s^2."""
    t, q, third = trace.time[rows], trace.q[rows], len(rows) // 3
    first, last = (float(np.polyfit(t[p] - t[p][0], q[p], 1)[0]) for p in (slice(0, third), slice(-third, None)))
    return first, last, (last - first) / float(t[-1 - third // 2] - t[third // 2])


def _gap(
    trace: Trace, out: tuple[int, int], back: tuple[int, int], sign: float, friction: float, load: float
) -> float | None:
    """The width of the loop at no torque: from its widths between +-1/2 and +-1/4 of the friction, as a line to 0.

    Between such levels the gear also winds up, in proportion to them.
    """
    top = friction - abs(load)
    middle = np.arange(out[0] + (out[1] - out[0]) // 2, back[0] + (back[1] - back[0]) // 2)
    width = max(1, round(SMOOTH / trace.period))
    tau = sign * np.convolve(trace.tau[middle], np.ones(width) / width, "same")  # type: ignore[index]
    noise = float(np.std(np.diff(trace.tau[middle]))) / np.sqrt(2.0 * width)  # type: ignore[index]
    if 0.25 * top < 3.0 * noise:
        return None
    half, quarter = (_between(trace.q[middle], tau, share * top, width) for share in (0.5, 0.25))
    return None if half is None or quarter is None else max(0.0, 2.0 * quarter - half)


def _between(q: np.ndarray, tau: np.ndarray, level: float, width: int) -> float | None:
    """The angle turned between the last time that tau (n,) is above a level and the first that it is below minus it."""
    above, below = np.flatnonzero(tau > level), np.flatnonzero(tau < -level)
    below = below[below > above[0]] if len(above) else below[:0]
    if not len(below):
        return None
    end = int(below[0])
    begin = int(above[above < end][-1])
    a, b = (float(np.mean(q[max(0, k - width // 2) : k + width // 2 + 1])) for k in (begin, end))
    return abs(b - a)


def line(
    speed: np.ndarray, height: np.ndarray, acceleration: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, int]:
    """Least squares of height = a + b speed, and + c acceleration where there is one.

    Returns:
        (values (2 or 3,), their covariance, degrees of freedom).
    """
    columns = [np.ones_like(speed), speed, *([] if acceleration is None else [acceleration])]
    design = np.column_stack(columns)
    x, *_ = np.linalg.lstsq(design, height, rcond=None)
    dof = len(speed) - design.shape[1]
    s2 = float(np.sum((height - design @ x) ** 2)) / max(dof, 1)
    return x, s2 * np.linalg.pinv(design.T @ design), dof
