"""Centre of mass: two or more suspensions, or the wrench at rest in four or more attitudes.

The centre of mass of an object that hangs from a point is on the plumb line through that point: two such lines, drawn
on a photograph, cross in it. At rest under gravity g (as a vector in the sensor's frame), a force and torque sensor
reads f = b_f + m g and t = b_t + c x m g with a bias b. Both are linear in the unknowns b_f, m, b_t and m c, which are
fitted to several attitudes (Hollerbach, Khalil, Gautier, Springer Handbook of Robotics, 2nd ed., 6.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations, product
from typing import Any

import numpy as np
from scipy import stats

from vispeg.core.errors import UserError
from vispeg.measure.outcome import Outcome, short
from vispeg.measure.readings import Readings, choose
from vispeg.measure.uncertainty import Input, propagate, rectangular

WRENCH, DOWN = ("fx", "fy", "fz", "tx", "ty", "tz"), ("gx", "gy", "gz")
FORMS = {
    "attitudes": (*WRENCH, *DOWN),
    "suspensions": ("x", "y", "angle"),
}
ATTITUDES, APART = 4, np.pi / 6  # least number of attitudes, and least angle in rad between the outermost
EXACT = 1e-12  # share of a sum of squares that may be rounding error
GRAVITY, LOCAL = 9.81, 0.03  # m/s^2, and its greatest deviation on the ground (9.780 to 9.832)


def measure(readings: Readings, rng: np.random.Generator) -> Outcome:
    """Compute the centre of mass: x and y on a drawing, or mass and x, y, z in the sensor's frame.

    Args:
        readings: a row per suspension: its point `x`, `y` (m) and the plumb line's `angle` to the x axis (rad); or a
            row per attitude: `fx` ... `tz` (N, N m) and gravity's direction `gx`, `gy`, `gz` in the same frame.
        rng: of the Monte Carlo propagation.

    Raises:
        UserError: too few or too similar lines or attitudes, or as for `attitudes`.
    """
    if choose(readings, FORMS) == "suspensions":
        return _lines(readings, rng)
    return attitudes(readings, rng)


def attitudes(readings: Readings, rng: np.random.Generator) -> Outcome:
    """Compute mass and centre of mass from wrenches at rest (N, N m) and gravity's direction in their frame.

    A sensor that reads the wrench of the flange on the tool, not the reverse, would give a negative mass. Then all
    signs are changed, and a note says so.

    Raises:
        UserError: fewer than four attitudes, no two of them 30 degrees apart, or all tilts about one axis; swapped
            columns or wrong signs; gravity with the wrong sign in one row, or of length 0.
    """
    wrench, down = (np.column_stack([readings[c] for c in names]) for names in (WRENCH, DOWN))
    length = np.linalg.norm(down, axis=1)
    bad = np.flatnonzero(length < 1e-6)
    if len(bad):
        raise UserError("gravity has no direction", file=readings.file, key=readings.row(bad[0]), expected="gx, gy, gz")
    down = down / length[:, None]
    apart = _apart(down)
    spread = np.linalg.svd(down - down.mean(axis=0), compute_uv=False)
    if len(down) < ATTITUDES or apart < APART or spread[1] < 0.1 * np.sqrt(len(down)):
        got = f"{len(down)} of them, {np.degrees(apart):.0f} degrees apart at most"
        expected = f"{ATTITUDES} or more that tilt about two axes, {np.degrees(APART):.0f} degrees or more apart"
        raise UserError(
            "attitudes that do not determine the centre of mass", file=readings.file, expected=expected, got=got
        )
    fits = [_fit(design(GRAVITY * down), y) for design, y in ((_weight, wrench[:, :3]), (_moment, wrench[:, 3:]))]
    _refuse_flipped(wrench[:, :3], down, readings)
    for fit, names in zip(fits, (WRENCH[:3], WRENCH[3:]), strict=True):
        _refuse_swapped(fit, names, readings)
    force, torque = fits
    mass, sign = float(force.x[3]), -1.0 if force.x[3] < 0 else 1.0
    scatter = Input("scatter of the forces", abs(mass), force.u(3), "A", force.dof, "t")
    scale = rectangular("local gravity", LOCAL / GRAVITY)
    of_forces, of_torques = _instruments(readings, wrench, down, force, torque)

    def weighed(m, g, *errors):
        return m * (1 + g) + sum(errors)

    inputs = [scatter, scale, *(rectangular(name, half) for name, (half, _) in of_forces.items())]
    results = [propagate("mass", "kg", weighed, inputs, rng, repeats=len(down))]
    for axis, name in enumerate("xyz"):
        first = Input(
            "scatter of the torques", sign * float(torque.x[3 + axis]), torque.u(3 + axis), "A", torque.dof, "t"
        )
        both = {**of_forces, **of_torques}
        shifts = [rectangular(key, 1.0) for key in both]  # each error in units of its limit moves mass and moment
        moves = [
            (sign * half if key in of_forces else 0.0, sign * moment[axis]) for key, (half, moment) in both.items()
        ]

        def centre(s, m, *errors, moves=moves):
            up = sum(e * moment for e, (_, moment) in zip(errors, moves, strict=True))
            return (s + up) / (m + sum(e * half for e, (half, _) in zip(errors, moves, strict=True)))

        results.append(propagate(f"com_{name}", "m", centre, [first, scatter, *shifts], rng, repeats=len(down)))
    notes = ["the forces point against the weight: signs turned round"] if sign < 0 else []
    details = {"force_bias_n": (sign * force.x[:3]).tolist(), "attitudes_apart_deg": float(np.degrees(apart))}
    return Outcome(tuple(results), tuple(notes), details)


@dataclass(frozen=True)
class _Fit:
    """A least-squares fit `y = base @ upper @ x`.

    Attributes:
        x: (k,) solution.
        rest: sum of the squared residuals.
        base: (3 n, k) orthonormal base of the design matrix.
        inverse: (k, k) inverse of `upper`.
        y: (3 n,) data, the three axes of each row in turn.
    """

    x: np.ndarray
    rest: float
    base: np.ndarray
    inverse: np.ndarray
    y: np.ndarray

    @property
    def dof(self) -> float:
        return float(len(self.y) - len(self.x))

    def u(self, k: int) -> float:
        """Return the standard uncertainty of x_k, estimated from the scatter."""
        return float(np.sqrt(self.rest / self.dof) * np.linalg.norm(self.inverse[k]))

    def residual(self, y: np.ndarray) -> float:
        """Return the sum of the squared residuals for other data y (3 n,)."""
        return float(y @ y - np.sum((self.base.T @ y) ** 2))

    def moved(self, by: np.ndarray) -> np.ndarray:
        """Return the change (k,) of x if y changes by `by` (3 n,)."""
        return self.inverse @ (self.base.T @ by)


def _fit(design: np.ndarray, values: np.ndarray) -> _Fit:
    base, upper = np.linalg.qr(design)
    inverse, y = np.linalg.inv(upper), values.reshape(-1)
    x = inverse @ (base.T @ y)
    return _Fit(x, float(np.sum((y - design @ x) ** 2)), base, inverse, y)


def _weight(g: np.ndarray) -> np.ndarray:
    """Return the design matrix (3 n, 4) of f = b + m g for g (n, 3) m/s^2; unknowns: bias (3,), mass."""
    return np.concatenate([np.tile(np.eye(3), (len(g), 1)), g.reshape(-1, 1)], axis=1)


def _moment(g: np.ndarray) -> np.ndarray:
    """Return the design matrix (3 n, 6) of t = b + (m c) x g for g (n, 3) m/s^2; unknowns: bias (3,), m c (3,)."""
    cross = np.zeros((len(g), 3, 3))  # s x g = cross s
    for row, column, of, sign in (
        (0, 1, 2, 1),
        (0, 2, 1, -1),
        (1, 0, 2, -1),
        (1, 2, 0, 1),
        (2, 0, 1, 1),
        (2, 1, 0, -1),
    ):
        cross[:, row, column] = sign * g[:, of]
    return np.concatenate([np.tile(np.eye(3), (len(g), 1)), cross.reshape(-1, 3)], axis=1)


def _instruments(
    r: Readings, wrench: np.ndarray, down: np.ndarray, force: _Fit, torque: _Fit
) -> tuple[dict[str, tuple[float, np.ndarray]], dict[str, tuple[float, np.ndarray]]]:
    """Return the half widths due to the instruments: source -> (mass, kg; moment (3,), kg m).

    Errors of resolution (half a digit) are independent in each row, so their effects add in squares. A limit of error
    is taken as an error of scale that is reached at the largest reading, because the fit already includes a constant
    bias. An error of gravity's direction changes the wrench that the model predicts.

    Returns:
        (sources that affect the mass, sources that affect only the moment).
    """
    rows = np.arange(len(down))
    weighing, turning = {}, {}
    moment = torque.x[3:]  # kg m
    for name, column in zip((*WRENCH, *DOWN), np.hstack([wrench, down]).T, strict=True):
        axis = (*WRENCH, *DOWN).index(name) % 3
        unit = np.eye(3)[axis]
        if name in DOWN:  # change of the predicted wrench per unit of gravity's direction along this axis
            on = (GRAVITY * force.x[3] * unit, GRAVITY * np.cross(moment, unit))
        else:
            on = (unit, 0.0 * unit) if name in WRENCH[:3] else (0.0 * unit, unit)
        about = column - column.mean()
        for kind, half in (
            ("resolution", 0.5 * r.resolution.get(name, 0.0)),
            ("limit of error", r.accuracy.get(name, 0.0)),
        ):
            if not half > 0:
                continue
            moves = []
            for fit, way in zip((force, torque), on, strict=True):
                if kind == "resolution":
                    axes = np.flatnonzero(way)
                    each = sum(
                        (way[k] * (fit.inverse @ fit.base[3 * rows + k].T) for k in axes),
                        np.zeros((len(fit.x), len(rows))),
                    )
                    moves.append(half * np.linalg.norm(each, axis=1))
                else:
                    moves.append(fit.moved(np.outer(half * about / (np.abs(about).max() or 1.0), way).reshape(-1)))
            (turning if name in WRENCH[3:] else weighing)[f"{kind} of {name}"] = (float(moves[0][3]), moves[1][3:])
    return weighing, turning


def _refuse_flipped(force: np.ndarray, down: np.ndarray, r: Readings) -> None:
    """Raise UserError if the forces (n, 3) fit a mass much better with the sign of gravity changed in one row."""
    n = len(down)
    fixed = float(np.sum((force - force.mean(axis=0)) ** 2))

    # sum of squared residuals of the fit f = b + m g, from the sums `total` (.., 3) of g and `along` of g . f
    def left(total, along):
        shared = along - total @ force.sum(axis=0) / n
        return fixed - shared**2 / (n - np.sum(total**2, axis=-1) / n)

    total, each = down.sum(axis=0), np.sum(down * force, axis=1)
    turned = left(total - 2.0 * down, each.sum() - 2.0 * each)
    row = int(np.argmin(turned))
    digits = EXACT * float(np.sum(force**2))
    if _surely(float(left(total, each.sum())), float(turned[row]) + digits, 3.0 * n - 4, n):
        expected = "gravity's direction as the force's"
        raise UserError("gravity is turned round", file=r.file, key=f"{r.row(row)}, gx gy gz", expected=expected)


def _refuse_swapped(fit: _Fit, names: Sequence[str], r: Readings) -> None:
    """Raise UserError if the columns fit a mass much better in another order or with other signs."""
    y, others = fit.y.reshape(-1, 3), {}
    for order in permutations(range(3)):
        for signs in ((1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1)):  # all signs changed would be the reaction
            others[order, signs] = fit.residual((y[:, order] * signs).reshape(-1))
    best = min(others, key=lambda key: others[key])
    if _surely(fit.rest, others[best] + EXACT * float(fit.y @ fit.y), fit.dof, len(others)):
        likely = " ".join(f"{'-' if s < 0 else ''}{names[k]}" for k, s in zip(*best, strict=True))
        raise UserError(
            f"{' '.join(names)} do not go with gravity", file=r.file, expected=f"one frame, likely {likely}"
        )


def _surely(left: float, other: float, dof: float, tried: int) -> bool:
    """Return whether another interpretation of a table, the best of `tried`, is significantly better.

    Its error must be less than half, and an F test must agree. `left` and `other` are sums of squared residuals.
    """
    ratio = left / max(other, 1e-300)
    return bool(ratio > 4.0 and stats.f.sf(ratio, dof, dof) < 0.001 / tried)


def _apart(down: np.ndarray) -> float:
    """Return the greatest angle between unit vectors (n, 3), rad, of which one is outermost in one of 13 directions."""
    ways = np.array([w for w in product((-1, 0, 1), repeat=3) if w > (0, 0, 0)], float)
    along = down @ ways.T
    outer = np.unique([along.argmin(axis=0), along.argmax(axis=0)])
    return float(np.arccos(np.clip(np.min(down[outer] @ down.T), -1.0, 1.0)))


def _lines(r: Readings, rng: np.random.Generator) -> Outcome:
    x, y, angle = r["x"], r["y"], r["angle"]
    turned = max((abs(np.sin(a - b)) for a, b in combinations(angle, 2)), default=0.0)
    if len(x) < 2 or turned < np.sin(APART):
        got = f"{len(x)}, {np.degrees(np.arcsin(turned)):.0f} degrees apart at most"
        expected = f"2 or more, {np.degrees(APART):.0f} degrees or more apart"
        raise UserError("plumb lines that do not cross well", file=r.file, expected=expected, got=got)
    inputs, owner = [], []
    for column in ("x", "y", "angle"):
        for at in range(len(x)):
            for error in r.instrument(column):
                inputs.append(Input(f"{error.name}, line {at + 1}", 0.0, error.u, error.kind, error.dof, error.shape))
                owner.append((column, at))
    normal = np.array([-np.sin(angle), np.cos(angle)]).T  # (n, 2)
    design = np.linalg.inv(normal.T @ normal)
    best = design @ (normal.T @ np.sum(normal * np.column_stack([x, y]), axis=1))
    miss = np.sum(normal * (np.column_stack([x, y]) - best), axis=1)
    dof = len(x) - 2
    results = []
    for axis, name in enumerate("xy"):
        scatter = []
        if dof > 0:
            u = np.sqrt(np.sum(miss**2) / dof * design[axis, axis])
            scatter = [Input("lines that miss each other", 0.0, float(u), "A", float(dof), "t")]

        skip = len(scatter)

        def crossing(*off, axis=axis, skip=skip):
            moved = {(c, at): r[c][at] for c in ("x", "y", "angle") for at in range(len(x))}
            for key, shift in zip(owner, off[skip:], strict=True):
                moved[key] = moved[key] + shift
            return _cross(moved, len(x))[axis] + sum(off[:skip])

        results.append(propagate(f"com_{name}", "m", crossing, [*scatter, *inputs], rng, repeats=len(x)))
    notes = [f"{note}, so that one checks where the others meet" for note in short(len(x), 3, "suspension")]
    return Outcome(tuple(results), tuple(notes), {"misses_m": miss.tolist()})


def _cross(line: dict[tuple[str, int], np.ndarray | float], count: int) -> tuple[Any, Any]:
    """Return the point (x, y) nearest to all lines, for floats or arrays: 2x2 normal equations by Cramer's rule."""
    a = b = c = p = q = np.float64(0.0)
    for at in range(count):
        nx, ny = -np.sin(line["angle", at]), np.cos(line["angle", at])
        along = nx * line["x", at] + ny * line["y", at]
        a, b, c = a + nx * nx, b + nx * ny, c + ny * ny
        p, q = p + nx * along, q + ny * along
    det = a * c - b * b
    return (c * p - b * q) / det, (a * q - b * p) / det
