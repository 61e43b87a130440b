"""Friction as a function of speed, from a joint's hysteresis loops: tau_c + b v + J a, and Stribeck's term if it shows.

The loops' heights are fitted by generalised least squares, because consecutive loops share rows of the log. The term
J a absorbs the remaining acceleration; the inertia J is not a result.
Curve: Armstrong-Helouvry et al., Automatica 30(7), 1994, eq. (1), (2) and (5) with exponent 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize, stats

from vispeg.measure.loops import Stroke
from vispeg.measure.trace import Trace
from vispeg.measure.uncertainty import Input, propagate, rectangular, repeated
from vispeg.worlds.measurement_file import Quantity

LEAST, WITH_INERTIA = 3, 5  # least number of strokes to fit Coulomb and viscous friction; to fit the inertia as well
GIVES_WAY = 0.3  # share of the inertia's correction that is uncertain: other joints yield, so J is not constant
BETWEEN = "servo's torque between two rows"
SURE = 0.001  # greatest probability of the F test at which Stribeck's term is accepted
STRIBECK, STARTS = (0.005, 0.5), (0.01, 0.03, 0.1, 0.3)  # rad/s: bounds of the effect `stribeck_friction`, and starts


@dataclass(frozen=True)
class Line:
    """A linear fit of values over speed and acceleration.

    Attributes:
        values: (k,) value at speed 0, slope over speed and, for k = 3 or more, slope over acceleration;
            with Stribeck's term, its height and the logarithm of its velocity come last.
        covariance: (k, k) of these.
        dof: degrees of freedom.
        rest: weighted sum of the squared residuals.
    """

    values: np.ndarray
    covariance: np.ndarray
    dof: int
    rest: float

    def input(self, name: str, k: int) -> Input:
        """Return value k with its standard uncertainty from the scatter about the line."""
        u = float(np.sqrt(self.covariance[k, k]))
        return Input(name, float(self.values[k]), u, kind="A", dof=float(self.dof), shape="t")


def separable(strokes: Sequence[Stroke]) -> bool:
    """Return whether there are enough strokes, and speeds, to separate a part that grows with speed from a constant."""
    speed = np.array([s.speed for s in strokes])
    return len(strokes) >= LEAST and bool(np.ptp(speed) > 0.5 * speed.min())


def line(strokes: Sequence[Stroke], values: np.ndarray, *, inertia: bool = True) -> Line:
    """Fit values (n,), one per stroke, over speed and, with five strokes or more, acceleration.

    The fit is by generalised least squares. Without `inertia`, the acceleration is left out.
    """
    root = linalg.cholesky(_covariance(strokes), lower=True)
    design, y = (linalg.solve_triangular(root, a, lower=True) for a in (_columns(strokes, inertia), values))
    x, *_ = np.linalg.lstsq(design, y, rcond=None)
    dof = len(strokes) - design.shape[1]
    rest = float(np.sum((y - design @ x) ** 2))
    return Line(x, rest / max(dof, 1) * np.linalg.pinv(design.T @ design), dof, rest)


def _columns(strokes: Sequence[Stroke], inertia: bool) -> np.ndarray:
    rows = [(1.0, s.speed, s.acceleration) for s in strokes]
    return np.array(rows)[:, : 3 if inertia and len(rows) >= WITH_INERTIA else 2]


def _covariance(strokes: Sequence[Stroke]) -> np.ndarray:
    """Return the covariance (n, n) of the loop heights for rows of variance 1; neighbours may share rows."""
    out = np.zeros((len(strokes), len(strokes)))
    for i, a in enumerate(strokes):
        for j, b in enumerate(strokes[: i + 1]):
            if a.trace is b.trace:
                _, at, of = np.intersect1d(a.rows, b.rows, assume_unique=True, return_indices=True)
                out[i, j] = out[j, i] = float(a.shares[at] @ b.shares[of])
    return out


def friction(
    strokes: Sequence[Stroke],
    traces: Sequence[Trace],
    results: list[Quantity],
    notes: list[str],
    details: dict[str, object],
    rng: np.random.Generator,
) -> None:
    """Add Coulomb and viscous friction to `results`, or only their sum if the strokes' speeds are too similar."""
    height = np.array([s.friction for s in strokes], float)
    if not separable(strokes):
        if len(strokes) >= 2:
            inputs = [repeated("loops", height)]
            results.append(propagate("friction", "N m", lambda x: x, inputs, rng, repeats=len(strokes)))
            notes.append("one speed: Coulomb and viscous friction cannot be separated")
        return
    curve = line(strokes, height)
    corrections = curve.values[:2] - line(strokes, height, inertia=False).values
    bent = _stribeck(strokes, height, curve)
    if bent is not None:
        curve, excess, velocity = bent
        notes.append(
            f"friction is {excess:.2g} N m higher at rest, and this excess falls to 37 % at {velocity:.2g} rad/s "
            "(Stribeck friction); coulomb_friction is the value without it"
        )
    if len(strokes) >= WITH_INERTIA:
        details["loop_inertia_kgm2"] = float(curve.values[2])
    for k, name, unit in ((0, "coulomb_friction", "N m"), (1, "viscous_friction", "N m s/rad")):
        moved = GIVES_WAY * abs(float(corrections[k]))
        inputs = [curve.input("loop heights about their curve", k), rectangular("inertia, as the arm gives way", moved)]
        inputs += _between_rows(strokes, traces) if name == "viscous_friction" else []
        if inputs[-1].name == BETWEEN and inputs[-1].u > inputs[0].u:
            notes.append(
                f"viscous friction is uncertain by {inputs[-1].u:.2g} N m s/rad, as the servo's torque changes between "
                "the rows: log the torque faster than the commands, or its mean"
            )
        results.append(propagate(name, unit, lambda *x: sum(x), inputs, rng, repeats=len(strokes)))


def _stribeck(strokes: Sequence[Stroke], height: np.ndarray, straight: Line) -> tuple[Line, float, float] | None:
    """Return the curve with Stribeck's term, and the term's height (N m) and velocity (rad/s).

    None unless an F test prefers it.
    """
    if straight.dof < 5 or np.ptp(height) == 0:
        return None
    columns, speed = _columns(strokes, True), np.array([s.speed for s in strokes])
    covariance = _covariance(strokes)

    def curve(_: object, *x: float) -> np.ndarray:
        return columns @ x[:-2] + x[-2] * np.exp(-((speed / np.exp(x[-1])) ** 2))

    low, high = np.full((2, columns.shape[1] + 2), [[-np.inf], [np.inf]])
    low[-2:], high[-1] = (0.0, np.log(STRIBECK[0])), np.log(STRIBECK[1])
    fits: list[tuple[float, np.ndarray, np.ndarray]] = []
    for velocity in STARTS:
        start = [*straight.values, 0.1 * abs(straight.values[0]), np.log(velocity)]
        with suppress(RuntimeError):  # no convergence from this start
            x, of_x = optimize.curve_fit(curve, speed, height, start, covariance, bounds=(low, high), x_scale="jac")
            residual = height - curve(speed, *x)
            fits.append((float(residual @ np.linalg.solve(covariance, residual)), x, of_x))
    if not fits:
        return None
    rest, x, of_x = min(fits, key=lambda fit: fit[0])
    dof = straight.dof - 2
    f = 0.5 * (straight.rest - rest) / max(rest / dof, 1e-300)
    return (Line(x, of_x, dof, rest), float(x[-2]), float(np.exp(x[-1]))) if stats.f.sf(f, 2, dof) < SURE else None


def _between_rows(strokes: Sequence[Stroke], traces: Sequence[Trace]) -> list[Input]:
    """Return the error of the viscous friction due to timing between the log's rows, N m s/rad.

    A row's torque may be sampled up to one row before or after its angle, with gravity torque changing in between.
    Also, a servo loop is faster than the log: its torque jumps with each command and decays until the next, so that the
    logged torque differs from its mean by up to half a command step times the loop's stiffness.
    """
    period = max(t.period for t in traces)
    slope = abs(max(strokes, key=lambda s: s.speed).slope)  # of the fastest stroke, which affects the fit most
    inputs = [rectangular("time between angle and torque, one row", slope * period)]
    if any(t.servo for t in traces):
        # a high quantile: noise and the encoder's dead band lower the estimate, at different speeds
        stiffness = float(np.quantile([s.stiffness for s in strokes], 0.9))
        inputs.append(rectangular(BETWEEN, 0.5 * max(stiffness, 0.0) * period))
    return inputs
