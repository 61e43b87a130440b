"""Fit a second-order step response with delay to steps: K, natural frequency, damping ratio, delay, bandwidth.

H(s) = K wn^2 e^(-d s) / (s^2 + 2 z wn s + wn^2). Its step response, for the poles p = wn (-z +- sqrt(z^2 - 1)):
1 + (p2 e^(p1 t) - p1 e^(p2 t)) / (p1 - p2), over- and underdamped alike. A swing that goes on from before the step is
taken from the angles before it and added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from vispeg.core.errors import UserError
from vispeg.measure.trace import Trace, steps

# s before a step between which the angle at rest is read; not up to the step, as a command may be logged late
BEFORE, LATE = 0.2, 0.1
STARTS, TRIED = (5.0, 20.0, 80.0, 250.0), 3  # rad/s, starts of the fit; number of the best starts that are used
POSITIVE = ("natural_frequency", "damping_ratio")
NAMES = {"gain": "1", "natural_frequency": "rad/s", "damping_ratio": "1", "delay": "s"}


@dataclass(frozen=True)
class Servo:
    """A second-order servo: gain K, natural frequency (rad/s), damping ratio, delay (s)."""

    gain: float
    natural_frequency: float
    damping_ratio: float
    delay: float

    @property
    def bandwidth_hz(self) -> float:
        """Frequency at which |H| is 3 dB below its value at rest, Hz."""
        a = 1.0 - 2.0 * self.damping_ratio**2
        return self.natural_frequency * float(np.sqrt(a + np.sqrt(a * a + 1.0))) / (2.0 * np.pi)

    def response(self, f: np.ndarray) -> np.ndarray:
        """Return H (n,), complex, at f (n,) Hz."""
        s = 2j * np.pi * np.asarray(f)
        wn, z = self.natural_frequency, self.damping_ratio
        return self.gain * wn**2 * np.exp(-s * self.delay) / (s**2 + 2 * z * wn * s + wn**2)


@dataclass(frozen=True)
class Step:
    """One step and its fit.

    Attributes:
        trace: the motion that contains it.
        start: s, time of the command's change.
        size: rad, signed.
        servo: fitted to it.
        rest: RMS residual as a share of the size.
    """

    trace: Trace
    start: float
    size: float
    servo: Servo
    rest: float


def step_answer(t: np.ndarray, wn: float, zeta: float) -> np.ndarray:
    """Return the unit step response (n,) at t (n,) s, 0 for t <= 0, of natural frequency wn rad/s and damping zeta."""
    root = np.sqrt(complex(zeta**2 - 1.0))
    root = root if abs(root) > 1e-6 else 1e-6 + 0j
    p1, p2 = wn * (-zeta + root), wn * (-zeta - root)
    late = np.maximum(t, 0.0)
    y = 1.0 + (p2 * np.exp(p1 * late) - p1 * np.exp(p2 * late)) / (p1 - p2)
    return np.where(t > 0, y.real, 0.0)


def fitted(trace: Trace) -> list[Step]:
    """Find the steps of a trace and fit each of them, starting also from the best fit so far."""
    out = list[Step]()
    for first, last in steps(trace):
        out.append(fit(trace, first, last, min(out, key=lambda step: step.rest).servo if out else None))
    return out


def before(trace: Trace, first: int) -> float:
    """Return the mean angle, rad, before the command changed in row `first`."""
    ago = trace.time[first] - trace.time
    return float(trace.q[(ago <= BEFORE + 1e-9) & (ago > LATE - 0.5 * trace.period)].mean())


def rested(trace: Trace, first: int, last: int, servo: Servo) -> tuple[float, np.ndarray]:
    """Return the angle about which the joint stood before a step, rad, and the swing about it that goes on.

    Both are fitted to the angles of one period up to `LATE` before the step, as those of this servo when its command
    rests. The swing, (n,) rad, is that in rows `first` to `last` (exclusive) if the command had not changed.
    """
    t, wn = trace.time, servo.natural_frequency
    end = int(np.searchsorted(t, t[first] - LATE + 0.5 * trace.period))
    changes = np.flatnonzero(np.abs(np.diff(trace.q_cmd[:first])) > 1e-9)
    earliest = t[changes[-1] + 1] + max(servo.delay, 0.0) if len(changes) else t[0]
    start = int(np.searchsorted(t, max(earliest, t[first] - max(BEFORE, LATE + 2 * np.pi / wn)) - 1e-9))
    start = min(start, int(np.searchsorted(t, t[first] - BEFORE - 1e-9)))
    at = np.concatenate([t[start:end], t[first:last]]) - t[start]
    e11, e12, _, _ = propagator(at, np.array(wn), np.array(servo.damping_ratio))
    swings, q = np.stack([e11, wn * e12], axis=1), trace.q[start:end]
    about = swings[: len(q)].mean(axis=0)
    sizes, *_ = np.linalg.lstsq(swings[: len(q)] - about, q - q.mean(), rcond=None)
    return float(q.mean() - about @ sizes), swings[len(q) :] @ sizes


def propagator(t: np.ndarray | float, wn: np.ndarray, zeta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the four entries (n,) of exp(A t) for x'' = -wn^2 x - 2 z wn x'."""
    root = np.sqrt((zeta**2 - 1.0).astype(complex))
    root = np.where(np.abs(root) > 1e-6, root, 1e-6)
    p1, p2 = wn * (-zeta + root), wn * (-zeta - root)
    a, b = np.exp(p1 * t), np.exp(p2 * t)
    gap = p1 - p2
    e11, e12 = (p1 * b - p2 * a) / gap, (a - b) / gap
    return e11.real, e12.real, (p1 * p2 * (b - a) / gap).real, ((p1 * a - p2 * b) / gap).real


def rows(step: Step) -> tuple[int, int]:
    """Return the rows (first, end) of a fitted step in its trace; `end` is exclusive."""
    return next((a, b) for a, b in steps(step.trace) if step.trace.time[a] == step.start)


def wound(servo: Servo, band: float, responses: Sequence[Step]) -> np.ndarray:
    """Return how far friction held the joint from its goal before each step, (n,) rad, cut to +-band.

    The sag under load, which is the median over the rests of a recording, is subtracted.
    """
    pull = np.empty(len(responses))
    for k, step in enumerate(responses):
        first, last = rows(step)
        pull[k] = servo.gain * step.trace.q_cmd[first - 1] - rested(step.trace, first, last, servo)[0]
    for trace in {s.trace for s in responses}:
        own = np.array([s.trace is trace for s in responses])
        pull[own] -= np.median(pull[own])
    return np.clip(pull, -band, band)


def fit(trace: Trace, first: int, last: int, like: Servo | None = None) -> Step:
    """Fit a second-order servo without friction to the step in rows `first` to `last` (exclusive) of a trace.

    `like` is a servo from which the fit starts too.
    """
    t = trace.time[first:last] - trace.time[first]
    size = float(trace.q_cmd[last - 1] - trace.q_cmd[first - 1])
    change = np.diff(trace.q_cmd[first - 1 : last]) / size
    moved = np.flatnonzero(np.abs(change) > 1e-6)
    parts = list(zip(t[moved], change[moved], strict=True))  # a command held from row to row is a sum of steps
    y = (trace.q[first:last] - before(trace, first)) / size
    end = float(np.median(y[-max(3, len(y) // 10) :]))

    def residual(x: np.ndarray) -> np.ndarray:
        wn, zeta = float(np.exp(x[1])), float(np.exp(x[2]))
        rest, swing = rested(trace, first, last, Servo(x[0], wn, zeta, x[3]))
        answer = x[0] * sum(share * step_answer(t - at - x[3], wn, zeta) for at, share in parts)
        return answer - (trace.q[first:last] - rest - swing) / size

    low = [-1.0, np.log(0.5), np.log(0.02), -LATE]
    high = [3.0, np.log(2000.0), np.log(20.0), max(0.2, 3 * trace.period)]
    edge = np.array(low) + 1e-9, np.array(high) - 1e-9
    starts = [[end, np.log(wn), np.log(0.7), late] for wn in STARTS for late in (0.0, _onset(t, y, end))]
    if like is not None:
        starts.append([like.gain, np.log(like.natural_frequency), np.log(like.damping_ratio), like.delay])
    near = sorted((np.clip(x0, *edge) for x0 in starts), key=lambda x0: float(np.sum(residual(x0) ** 2)))[:TRIED]
    tries = [optimize.least_squares(residual, x0, bounds=(low, high), x_scale=[0.1, 0.3, 0.3, 0.01]) for x0 in near]
    best = min(tries, key=lambda solution: solution.cost)
    gain, wn, zeta = float(best.x[0]), float(np.exp(best.x[1])), float(np.exp(best.x[2]))
    rest = float(np.sqrt(np.mean(best.fun**2)))
    delay = float(best.x[3])
    return Step(trace, float(trace.time[first]), size, Servo(gain, wn, zeta, delay), rest)


def _onset(t: np.ndarray, y: np.ndarray, end: float) -> float:
    """Return the time at which the response passes 5 % of its end value, s; 0 if it never does."""
    past = np.flatnonzero(y * np.sign(end or 1.0) > 0.05 * abs(end))
    return float(t[past[0]]) if len(past) else 0.0


def groups(responses: Sequence[Step]) -> dict[float, list[Step]]:
    """Group steps by size and direction: signed size, rad -> steps; sizes within 5 % belong together."""
    out: dict[float, list[Step]] = {}
    for step in sorted(responses, key=lambda s: s.size):
        near = [size for size in out if abs(size - step.size) <= 0.05 * abs(step.size)]
        out.setdefault(near[0] if near else step.size, []).append(step)
    return out


def parameters(responses: Sequence[Step]) -> dict[str, np.ndarray]:
    """Return name -> means (ngroup,) over each group of steps: gain, natural_frequency, damping_ratio, delay.

    Means of natural frequency and damping ratio are geometric, as these are positive and spread in proportion.
    """
    means = [
        [_mean(name, [getattr(s.servo, name) for s in group]) for name in NAMES] for group in groups(responses).values()
    ]
    return dict(zip(NAMES, np.array(means).T, strict=True))


def mean_servo(responses: Sequence[Step]) -> Servo:
    """Return the servo whose numbers are the means over groups of steps."""
    return Servo(**{name: _mean(name, values) for name, values in parameters(responses).items()})


def about(groups: Mapping[str, np.ndarray], servo: Servo) -> dict[str, np.ndarray]:
    """Shift or scale numbers (ngroup,) by name so that their mean is this servo."""
    means = {name: (getattr(servo, name), _mean(name, groups[name])) for name in NAMES}
    moved = {n: groups[n] * to / at if n in POSITIVE else groups[n] + to - at for n, (to, at) in means.items()}
    return {**groups, **moved}


def _mean(name: str, values: Sequence[float] | np.ndarray) -> float:
    return float(np.exp(np.mean(np.log(values))) if name in POSITIVE else np.mean(values))


def sizes(responses: Sequence[Step]) -> list[float]:
    """List the different sizes of steps, rad, regardless of direction, in ascending order."""
    out: list[float] = []
    for size in sorted(abs(s.size) for s in responses):
        if not out or size > 1.05 * out[-1]:
            out.append(size)
    return out


def refuse_drift(responses: Sequence[Step], file: str) -> None:
    """Raise UserError if the gain or frequency of equal steps differs between the first and the last recording.

    The difference must be more than 2 % and significant at three sigma.
    """
    for size, group in groups(responses).items():
        traces = list(dict.fromkeys(s.trace for s in group))
        if len(traces) < 2:
            continue
        for name in ("gain", "natural_frequency"):
            first, last = ([getattr(s.servo, name) for s in group if s.trace is t] for t in (traces[0], traces[-1]))
            if min(len(first), len(last)) < 3 or np.ptp(first) + np.ptp(last) == 0:
                continue
            apart = abs(np.mean(first) - np.mean(last)) > 0.02 * abs(np.mean(first))
            if apart and stats.ttest_ind(first, last, equal_var=False).pvalue < 0.0027:
                got = f"{np.mean(first):.4g} and {np.mean(last):.4g}"
                expected = "the same within three standard uncertainties"
                what = f"{name} of steps of {size:.3g} rad has drifted between {traces[0].name} and {traces[-1].name}"
                raise UserError(what, file=file, expected=expected, got=got)
