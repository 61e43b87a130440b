"""Fit one servo with dry friction to all steps of a joint: q'' = wn^2 (K u + b - q - h s) - 2 z wn q', s = sign q'.

h = friction / stiffness, rad, is half the width of the band of angles at which the joint may come to rest; b is the sag
under load in each recording. A joint at rest stays there while |K u + b - q| <= h, so the angle at which it rested
before a step shows the friction force that holds it. Fits of single steps would mistake this force for a different
gain, and the friction during the motion for a different damping.
Between two reversals the joint moves like the linear servo about a shifted goal (den Hartog, Trans. ASME 53, 1931).
The uncertainty is that of the mean over sizes and directions of steps: pseudo-values of a jackknife that leaves out one
of them, by one Gauss-Newton step from the common fit (Efron and Stein, Ann. Statist. 9(3), 1981).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from vispeg.measure import steps
from vispeg.measure.steps import Servo, Step

FINE = 0.1  # rad of the servo's phase per integration step; a reversal is then located to a hundredth of a step
FINER = 2  # steps of the simulated arm in each integration step
SAMPLES = 300  # greatest number of samples of a step that are compared
NEAR = 30  # greatest number of evaluations in the fit of a simulated joint
SLOPE = 1e-4  # relative step of finite differences; for the band, a share of the smallest goal step

# A function that simulates steps. Arguments: goals (nstep, ngrid) rad relative to those at rest, interval of the grid
# in s, distance (nstep,) rad at which friction held the joint from its goal. Returns: angles and speeds
# (nstep, ngrid + 1), rad and rad/s.
Moved = Callable[[np.ndarray, float, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Shared:
    """One servo with friction, fitted to all steps.

    Attributes:
        servo: the servo.
        band: rad, half the width of the band of angles at which the joint may rest; 0 without friction.
        groups: name -> (ngroup,) pseudo-values, one per size and direction: gain, natural_frequency, damping_ratio,
            delay, rest_band.
        left: (nstep,) RMS residual of each step as a share of its size.
        problem, x: data and solution of the fit.
        responses: the steps.
    """

    servo: Servo
    band: float
    groups: dict[str, np.ndarray]
    left: np.ndarray
    problem: _Problem
    x: np.ndarray
    responses: Sequence[Step]

    def nearest(
        self, joint: Callable[[np.ndarray, float], tuple[Moved, float]], start: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fit a simulated joint to the steps themselves.

        Args:
            joint: takes the four parameters of a position loop (`Servo`'s, the delay last) and the friction band in
                rad; returns the simulation of the joint, and its gain, angle over goal.
            start: the numbers to begin with.

        Returns:
            (5,) the four parameters and the band; (5, ngroup) their pseudo-values, as in `groups`; (nstep,) RMS
            residual of each step as a share of its size.
        """
        p, least = self.problem, float(np.min(np.abs(self.problem.size)))
        goals = np.repeat(p.goals, FINER, axis=1) * p.size[:, None]
        unit = np.array([1.0, 1.0, 1.0, 0.1, *np.full(1 + p.sags, 0.1 * least)])
        free = np.arange(len(unit)) != (-1 if self.band > 0.0 else 4)

        def residual(x: np.ndarray) -> np.ndarray:
            moved, gain = joint(x[:4], max(x[4], 0.0))
            q, v = moved(goals, p.dt / FINER, gain * p.command + x[5:][p.trace] - p.rest)
            y = _read(q, v, p.dt / FINER, p.t - x[3]) / p.size[:, None]
            return ((y - p.y) * p.weight).reshape(-1)

        def whole(z: np.ndarray) -> np.ndarray:
            x = x0.copy()
            x[free] += unit[free] * z
            return x

        def slopes(z: np.ndarray) -> np.ndarray:
            now = residual(whole(z))
            return np.stack([(residual(whole(z + SLOPE * e)) - now) / SLOPE for e in np.eye(len(z))], axis=1)

        gain = joint(start, self.band)[1]
        middle = np.array([p.command[p.trace == k].mean() for k in range(p.sags)])
        x0 = np.concatenate([start, [self.band], (self.x[0] - gain) * middle + self.x[5:]])
        found = optimize.least_squares(lambda z: residual(whole(z)), np.zeros(free.sum()), slopes, max_nfev=NEAR)
        fun = found.fun.reshape(p.y.shape)
        moves = _moves(found.jac.reshape(*p.y.shape, -1), fun, self.responses)
        x = whole(found.x)
        x[4] = max(x[4], 0.0)
        each = np.repeat(x[:, None], len(moves), axis=1)
        each[free] -= unit[free, None] * (len(moves) - 1) * (moves - moves.mean(axis=0)).T
        return x[:5], each[:5], np.sqrt(np.sum(fun**2, axis=1))


@dataclass(frozen=True)
class _Problem:
    """The data of the fit, a row per step; `goals` and `y` are shares of its size, from where the joint rested."""

    goals: np.ndarray  # (nstep, ngrid), mean command of each interval of the grid
    dt: float  # s, of the grid
    t: np.ndarray  # (nstep, nsample), s
    y: np.ndarray  # (nstep, nsample)
    weight: np.ndarray  # (nstep, nsample), 0 beyond the end of a step
    size: np.ndarray  # (nstep,) rad
    command: np.ndarray  # (nstep,) rad, before the step
    rest: np.ndarray  # (nstep,) rad, the angle before it
    trace: np.ndarray  # (nstep,), index of the recording
    sags: int  # number of recordings, each of which has a sag of its own


def shared(responses: Sequence[Step]) -> Shared:
    """Fit one servo with friction to all steps, starting from the mean of their single fits."""
    start = steps.mean_servo(responses)
    p = _problem(responses, start)
    first = [start.gain, np.log(start.natural_frequency), np.log(start.damping_ratio), start.delay]
    sags = [float(np.median((p.rest - start.gain * p.command)[p.trace == k])) for k in range(p.sags)]
    wound = float(np.max(np.abs(steps.wound(start, np.inf, responses))))
    return _solve(p, responses, [np.array([*first, band, *sags]) for band in (0.0, wound)])


def _solve(p: _Problem, responses: Sequence[Step], starts: Sequence[np.ndarray]) -> Shared:
    least = float(np.min(np.abs(p.size)))
    scale = np.concatenate([[0.1, 0.3, 0.3, 0.01], np.full(1 + p.sags, 0.1 * least)])
    low, high = np.full((2, len(scale)), [[-np.inf], [np.inf]])
    low[:5] = -1.0, np.log(0.5), np.log(0.02), -steps.LATE, 0.0
    high[:4] = 3.0, np.log(2000.0), np.log(20.0), 0.3
    best = None
    for x0 in starts:
        inside = np.clip(x0, low, high)
        inside[4] = max(inside[4], 1e-3 * least)  # not 0, where the derivative with respect to the band vanishes
        found = optimize.least_squares(
            lambda x: _residual(x, p),
            inside,
            lambda x: _slopes(x, p, least),
            (low, high),
            x_scale=scale,
            max_nfev=40,
        )
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    servo = Servo(float(best.x[0]), float(np.exp(best.x[1])), float(np.exp(best.x[2])), float(best.x[3]))
    left = np.sqrt(np.sum(best.fun.reshape(p.y.shape) ** 2, axis=1))
    sticks = bool(best.x[4] > 1e-6 * least)  # else the band is at its bound 0: no friction, and the band is fixed
    groups = _groups(best, p, responses, sticks)
    return Shared(servo, sticks * float(best.x[4]), groups, left, p, best.x, responses)


def _problem(responses: Sequence[Step], start: Servo) -> _Problem:
    traces = list(dict.fromkeys(s.trace for s in responses))
    spans = [steps.rows(s) for s in responses]
    longest = max(s.trace.time[b - 1] - s.start for s, (_, b) in zip(responses, spans, strict=True))
    period = min(t.period for t in traces)
    fine = FINE / start.natural_frequency
    dt = period / np.ceil(period / fine) if period > fine else period * max(1.0, np.floor(0.5 * fine / period))
    grid = np.arange(int(np.ceil(longest / dt)) + 2) * dt
    shape = len(responses), min(SAMPLES, max(b - a for a, b in spans))
    goals, t, y, weight = np.zeros((shape[0], len(grid) - 1)), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    rest, command = np.zeros(shape[0]), np.zeros(shape[0])
    for k, (step, (a, b)) in enumerate(zip(responses, spans, strict=True)):
        trace = step.trace
        time = trace.time[a:b] - step.start
        command[k] = trace.q_cmd[a - 1]
        rest[k], swing = steps.rested(trace, a, b, start)
        change = (trace.q_cmd[a:b] - command[k]) / step.size
        total = np.concatenate([[0.0], np.cumsum(change[:-1] * np.diff(time))])  # each command is held for its row
        whole = np.interp(grid, time, total)
        whole += change[-1] * np.maximum(grid - time[-1], 0.0)
        goals[k] = np.diff(whole) / dt
        used = np.unique(np.linspace(0, len(time) - 1, shape[1]).round().astype(int))
        t[k, : len(used)], weight[k, : len(used)] = time[used], 1.0 / np.sqrt(len(used))
        y[k, : len(used)] = (trace.q[a:b][used] - rest[k] - swing[used]) / step.size
    size = np.array([s.size for s in responses])
    trace_of = np.array([traces.index(s.trace) for s in responses])
    return _Problem(goals, float(dt), t, y, weight, size, command, rest, trace_of, len(traces))


def _residual(x: np.ndarray, p: _Problem) -> np.ndarray:
    return ((_answers(x[None], p)[0] - p.y) * p.weight).reshape(-1)


def _slopes(x: np.ndarray, p: _Problem, least: float) -> np.ndarray:
    """Return the derivatives of `_residual`, (nstep * nsample, 5 + ntrace), by finite differences.

    The sags of all traces are moved in one evaluation, as each affects only its own steps.
    """
    by = SLOPE * np.array([1.0, 1.0, 1.0, 0.1, 0.1 * least, 0.1 * least])
    moves = np.zeros((7, len(x)))
    moves[range(1, 6), range(5)] = by[:5]
    moves[6, 5:] = by[5]
    y = _answers(x + moves, p) * p.weight
    slopes = (y[1:] - y[0]) / by[:, None, None]
    out = np.zeros((len(x), *p.y.shape))
    out[:5] = slopes[:5]
    for k in range(p.sags):
        out[5 + k] = slopes[5] * (p.trace == k)[:, None]
    return out.reshape(len(x), -1).T


def _answers(x: np.ndarray, p: _Problem) -> np.ndarray:
    """Simulate servos x (nx, 5 + ntrace); return angles (nx, nstep, nsample) as shares of the steps' sizes."""
    nx, nstep = len(x), len(p.size)
    gain, wn, zeta = (np.repeat(v, nstep) for v in (x[:, 0], np.exp(x[:, 1]), np.exp(x[:, 2])))
    share = np.sign(p.size)[None] / np.abs(p.size)[None]  # 1 / size
    band = (x[:, 4:5] * np.abs(share)).reshape(-1)
    wound = x[:, :1] * p.command + x[:, 5:][:, p.trace] - p.rest
    wound = (np.clip(wound, -x[:, 4:5], x[:, 4:5]) * share).reshape(-1)
    q, v = _integrated(np.tile(p.goals, (nx, 1)), p.dt, gain, wn, zeta, band, wound)
    late = (p.t[None] - x[:, 3, None, None]).reshape(nx * nstep, -1)
    return _read(q, v, p.dt, late).reshape(nx, nstep, -1)


def _read(q: np.ndarray, v: np.ndarray, dt: float, t: np.ndarray) -> np.ndarray:
    """Interpolate angles at t (n, nsample) s, by cubic splines, from q and v (n, ngrid + 1) on a grid of dt s."""
    at = np.clip(t / dt, 0.0, q.shape[1] - 1.001)
    k = at.astype(int)
    r, row = at - k, np.arange(len(q))[:, None]
    a, b, va, vb = q[row, k], q[row, k + 1], dt * v[row, k], dt * v[row, k + 1]
    return a + r * (va + r * (3 * (b - a) - 2 * va - vb + r * (2 * (a - b) + va + vb)))


def _integrated(
    goals: np.ndarray,
    dt: float,
    gain: np.ndarray,
    wn: np.ndarray,
    zeta: np.ndarray,
    band: np.ndarray,
    wound: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate n joints from rest: goals (n, ngrid), other parameters (n,); return angle and speed (n, ngrid + 1).

    The solution is exact while a joint moves in one direction. If it reverses within an interval, its speed in that
    interval is taken as linear in time.
    """
    n, count = goals.shape
    e11, e12, e21, e22 = steps.propagator(dt, wn, zeta)
    q, v = np.zeros((count + 1, n)), np.zeros((count + 1, n))
    x, dx = np.zeros(n), np.zeros(n)
    for k in range(count):
        free = gain * goals[:, k] + wound
        pull = free - x
        way = np.where(dx != 0.0, np.sign(dx), np.where(np.abs(pull) > band, np.sign(pull), 0.0))
        end = free - way * band
        off = x - end
        then, speed = end + e11 * off + e12 * dx, e21 * off + e22 * dx
        turned = way * speed < 0.0
        if turned.any():
            part = np.where(turned, dx / np.where(turned, dx - speed, 1.0), 1.0)
            turn = x + 0.5 * part * dt * dx
            rest, left = free - turn, (1.0 - part) * dt
            pulls = np.sign(rest) * np.maximum(np.abs(rest) - band, 0.0)
            back = left * wn**2 * pulls
            then, speed = np.where(turned, turn + 0.5 * left * back, then), np.where(turned, back, speed)
        x, dx = np.where(way == 0.0, x, then), np.where(way == 0.0, 0.0, speed)
        q[k + 1], v[k + 1] = x, dx
    return q.T, v.T


def _groups(
    best: optimize.OptimizeResult, p: _Problem, responses: Sequence[Step], sticks: bool
) -> dict[str, np.ndarray]:
    """Return the jackknife's pseudo-values over sizes and directions, or over steps if there is only one of these."""
    free = np.arange(len(best.x)) != (-1 if sticks else 4)
    moves = _moves(best.jac.reshape(*p.y.shape, -1)[..., free], best.fun.reshape(p.y.shape), responses)
    x = np.repeat(best.x[:, None], len(moves), axis=1)
    x[free] -= (len(moves) - 1) * moves.T  # n x - (n - 1) (x + move)
    return {
        "gain": x[0],
        "natural_frequency": np.exp(x[1]),
        "damping_ratio": np.exp(x[2]),
        "delay": x[3],
        "rest_band": x[4],
    }


def _moves(jac: np.ndarray, rest: np.ndarray, responses: Sequence[Step]) -> np.ndarray:
    """Return how far (ngroup, nx) a fit moves if each size and direction is left out in turn.

    With only one size and direction, single steps are left out. The move is one Gauss-Newton step, from the Jacobian
    jac (nstep, nsample, nx) and the residual rest (nstep, nsample).
    """
    groups = list(steps.groups(responses).values())
    groups = groups if len(groups) > 1 else [[s] for s in responses]
    normal, right = np.einsum("sni,snj->sij", jac, jac), np.einsum("sni,sn->si", jac, rest)
    moves = []
    for group in groups:
        kept = np.array([not any(s is other for other in group) for s in responses])
        moves.append(-np.linalg.pinv(normal[kept].sum(axis=0)) @ right[kept].sum(axis=0))
    return np.array(moves)
