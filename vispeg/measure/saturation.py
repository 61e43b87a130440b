"""The torque limit of a drive, if a log shows that the motor gives less torque than its control law asks for.

A servo's control law asks for the torque `k u - k' q - d q' + a` of command u, angle q, speed q' and a constant a,
independent of friction and inertia. The motor gives at most `stall (1 - v / no_load)` at the speed v in the torque's
direction (`vispeg.effects.drive.torque_speed_limit`). Law and limit are fitted to all steps at once. A limit is found
if, in the rows at the limit, a law fitted without one has at least twice the RMS error of the law with it. The limit
falls with speed if three steps or more reach it, and the slope that they show is significantly above 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from vispeg.measure.steps import BEFORE, LATE, Step, before, rows
from vispeg.measure.trace import LIKELIER, Trace
from vispeg.measure.uncertainty import Input, coverage, rectangular, repeated

AFTER = 0.5  # s from a step on whose rows are used
BEYOND = 4.0  # a row is at the limit if the law asks for more than it by this many standard deviations of the noise
REACHED = 3  # least number of such rows with which a step reaches the limit; a delay of one row causes one or two
SURE = 0.998  # two-sided confidence: of constant limits, one in a thousand seems to fall with speed
SPEEDS = 6  # number of speeds in the table of torques


@dataclass(frozen=True)
class Limit:
    """A torque limit that steps show.

    Attributes:
        stall: (nreached,) N m, estimates of the limit at rest, one per step that reaches it: jackknife pseudo-values if
            it falls with speed, else medians.
        slope: (nreached,) s/rad, pseudo-values of 1 / no-load speed; empty if the limit does not fall with speed.
        noise: N m, standard deviation of the measured torque about the fit.
        one_row: (2,) changes of stall (N m) and slope (s/rad) if torques are paired with the speeds of the row before;
            0 if the limit does not fall.
        reached: the steps that reach the limit.
    """

    stall: np.ndarray
    slope: np.ndarray
    noise: float
    one_row: np.ndarray
    reached: list[Step]

    def inputs(self) -> list[Input]:
        """Return the limit at rest, N m, as inputs of `propagate` that add up to it."""
        if len(self.stall) < 2:
            return [rectangular("noise of the torque", 2.0 * self.noise, float(self.stall[0]))]
        return [
            repeated("steps at the limit", self.stall),
            rectangular("time of the speed", self.one_row[0]),
        ]

    def inputs_of_slope(self) -> list[Input]:
        """Return the slope, s/rad, as inputs of `propagate` that add up to it; only for a limit that falls."""
        return [
            repeated("slope over the steps at the limit", self.slope),
            rectangular("time of the speed", self.one_row[1]),
        ]


@dataclass(frozen=True)
class _Rows:
    """The n rows of the log that lie in steps; a law has three coefficients, (k, -k', -d)."""

    rest: np.ndarray  # (n,) N m, torque at rest before the step
    factors: np.ndarray  # (n, 3), of the coefficients: changes of command and angle since before the step, rad; rad/s
    tau: np.ndarray  # (n,) N m, measured torque
    speed: np.ndarray  # (n,) rad/s
    earlier: np.ndarray  # (n,) rad/s, speed one row before
    step: np.ndarray  # (n,) index of the step

    def asked(self, law: np.ndarray) -> np.ndarray:
        """Return the torque (n,) N m that a law with these coefficients (3,) asks for."""
        return self.rest + self.factors @ law


def limit(responses: Sequence[Step]) -> Limit | None:
    """Find the torque limit that the motor reaches in some of these fitted steps; None if none shows.

    Steps with a measured torque that has a sign are used; with fewer than two of them, no limit shows.
    """
    steps = [s for s in responses if s.trace.signed() and not s.trace.asked]
    if len(steps) < 2:
        return None
    r = _rows(steps)
    best = None
    for top in np.quantile(np.abs(r.tau), (1.0, 0.99, 0.97, 0.9)):
        for slope in (0.0, 0.3 / max(float(np.abs(r.speed).max()), 1e-9)):
            x0 = np.concatenate([[top, slope], _fit_law(r, 0.8 * top)])
            scale = np.concatenate([[top, 0.3], np.abs(x0[2:]) + 1e-9])
            low = np.array([1e-3 * top, 0.0, 0.0, -np.inf, -np.inf])
            found = optimize.least_squares(
                lambda x: _delivered(x, r) - r.tau,
                np.maximum(x0, low),
                lambda x: _jacobian(x, r),
                (low, np.inf),
                x_scale=scale,
                max_nfev=60,
            )
            best = found if best is None or found.cost < best.cost else best
    assert best is not None
    noise = float(np.sqrt(2.0 * best.cost / max(len(r.tau) - len(best.x), 1)))
    over = np.abs(r.asked(best.x[2:])) > _limit_at(best.x, r) + BEYOND * noise
    count = np.bincount(r.step[over], minlength=len(steps))
    at = np.flatnonzero(count >= REACHED)
    over &= np.isin(r.step, at)
    models = r.asked(_fit_law(r, np.inf)), _delivered(best.x, r)
    unlimited, limited = (float(np.sum((torque - r.tau)[over] ** 2)) for torque in models)
    if not len(at) or unlimited < LIKELIER * limited:
        return None
    size, whose, reached = np.abs(r.tau[over]), r.step[over], [steps[k] for k in at]
    if len(at) > 2:
        now, earlier = (np.maximum(v[over] * np.sign(r.tau[over]), 0.0) for v in (r.speed, r.earlier))
        whole = _fit_line(size, now)
        # pseudo-values of the jackknife over steps
        without = np.array([_fit_line(size[whose != k], now[whose != k]) for k in at])
        each = len(at) * whole - (len(at) - 1) * without
        slope = repeated("slope", each[:, 1])
        if slope.value > coverage(slope.dof, SURE) * slope.u:
            return Limit(each[:, 0], each[:, 1], noise, np.abs(_fit_line(size, earlier) - whole), reached)
    flat = np.array([np.median(size[whose == k]) for k in at])
    return Limit(flat, np.zeros(0), noise, np.zeros(2), reached)


def _rows(steps: Sequence[Step]) -> _Rows:
    """Return the rows in the steps, from BEFORE s before each to AFTER s after it, or to its end.

    Commands are delayed by the time, from 0 to below LATE s, with which a law fits the torques best.
    """
    spans = [rows(s) for s in steps]
    rates = {t: np.gradient(t.q, t.time) for t in {s.trace for s in steps}}
    period = max(t.period for t in rates)

    def with_delay(late: float) -> _Rows:
        columns = []
        for n, (step, (first, end)) in enumerate(zip(steps, spans, strict=True)):
            trace = step.trace
            assert trace.tau is not None
            ago = trace.time[first] - trace.time
            used = np.flatnonzero((ago <= BEFORE + 1e-9) & (ago > -AFTER))
            used = used[trace.time[used] < trace.time[min(end, len(trace.time) - 1)]]
            still = trace.tau[(ago <= BEFORE + 1e-9) & (ago > LATE - 0.5 * trace.period)].mean()
            t, q = trace.time[used], before(trace, first)
            row = np.maximum(np.searchsorted(trace.time, t - late + 1e-9, side="right") - 1, 0)  # a command is held
            speed = rates[trace][used]
            earlier = np.interp(t - trace.period, trace.time, rates[trace])
            factors = [trace.q_cmd[row] - trace.q_cmd[first - 1], trace.q[used] - q, speed]
            columns.append(
                (np.full(len(t), still), np.column_stack(factors), trace.tau[used], speed, earlier, 0 * used + n)
            )
        return _Rows(*(np.concatenate(x) for x in zip(*columns, strict=True)))

    def error_of(late: float) -> float:
        """Return the sum of absolute errors, N m; squares would give rows at the limit too much weight."""
        r = with_delay(late)
        laws = [_fit_law(r, share * float(np.abs(r.tau).max())) for share in (0.8, 2.0)]
        return min(float(np.sum(np.abs(r.asked(law) - r.tau))) for law in laws)

    late = min(np.arange(0.0, LATE, period), key=lambda x: error_of(float(x)))
    return with_delay(float(late))


def _fit_law(r: _Rows, top: float) -> np.ndarray:
    """Fit the coefficients (3,) of a law to the rows whose torque is below `top` N m in size."""
    low = np.abs(r.tau) < top
    return np.linalg.lstsq(r.factors[low], (r.tau - r.rest)[low], rcond=None)[0]


def _limit_at(x: np.ndarray, r: _Rows) -> np.ndarray:
    """Return the limit (n,) N m at each row's speed in the direction of the torque asked for; x as for `_delivered`."""
    forward = np.maximum(r.speed * np.sign(r.asked(x[2:])), 0.0)
    return x[0] * np.maximum(1.0 - x[1] * forward, 0.0)


def _delivered(x: np.ndarray, r: _Rows) -> np.ndarray:
    """Return the torque (n,) N m that is asked for, cut at the limit.

    x (5,) holds the stall torque (N m), 1 / no-load speed (s/rad) and the three coefficients of the law.
    """
    most = _limit_at(x, r)
    return np.clip(r.asked(x[2:]), -most, most)


def _jacobian(x: np.ndarray, r: _Rows) -> np.ndarray:
    """Return the derivatives of `_delivered` by the components of x, (n, 5)."""
    asked, most = r.asked(x[2:]), _limit_at(x, r)
    over, way = np.abs(asked) > most, np.sign(asked)
    forward = np.maximum(r.speed * way, 0.0)
    limit_ = np.column_stack([way * most / x[0], -way * x[0] * forward * (most > 0.0)])
    return np.hstack([limit_ * over[:, None], r.factors * ~over[:, None]])


def _fit_line(size: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """Fit a falling line to torques (n,) N m over speeds (n,) rad/s.

    Returns:
        (2,): torque at rest, N m, and 1 / speed of zero torque, s/rad.
    """
    stall, fall = np.linalg.lstsq(np.column_stack([np.ones_like(forward), -forward]), size, rcond=None)[0]
    return np.array([stall, fall / stall])


def by_speed(traces: Sequence[Trace]) -> list[dict[str, float]]:
    """Return a table of the greatest torque (N m) in each of SPEEDS ranges of speed (rad/s) in the torque's direction.

    `speed_rad_s` is the middle of the range; ranges without rows are left out. Without a signed torque it is empty.
    """
    pairs = [(t.tau, np.gradient(t.q, t.time)) for t in traces if t.tau is not None and t.signed()]
    if not pairs:
        return []
    tau, speed = (np.concatenate(x) for x in zip(*pairs, strict=True))
    forward = speed * np.sign(tau)
    edges = np.linspace(0.0, max(float(forward.max()), 1e-9), SPEEDS + 1)
    out = []
    for a, b in zip(edges, edges[1:], strict=False):
        torques = np.abs(tau[(forward >= a) & (forward <= b)])
        if len(torques):
            out.append({"speed_rad_s": float(0.5 * (a + b)), "greatest_torque_nm": float(torques.max())})
    return out
