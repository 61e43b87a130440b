"""Centre of mass: two or more suspensions, or the wrench at rest in four or more attitudes.

Hung from a point, a thing has its centre of mass on the plumb line through that point: two such lines, drawn on a
photograph, cross in it. At rest under gravity g (as a vector in the sensor's frame), a force and torque sensor reads
f = b_f + m g and t = b_t + c x m g with a bias b; over attitudes both are linear in b_f, m, b_t and m c (Hollerbach,
Khalil, Gautier, Springer Handbook of Robotics, 2nd ed., 6.3).
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.measure.outcome import Outcome, short
from vispeg.measure.readings import Readings, choose
from vispeg.measure.uncertainty import Input, propagate, rectangular

FORMS = {
    "attitudes": ("fx", "fy", "fz", "tx", "ty", "tz", "gx", "gy", "gz"),
    "suspensions": ("x", "y", "angle"),
}
ATTITUDES, APART = 4, np.pi / 6
GRAVITY, LOCAL = 9.81, 0.03  # m/s^2, and how far it is from that on the ground (9.780 to 9.832)


def measure(readings: Readings, rng: np.random.Generator) -> Outcome:
    """Where the centre of mass is: x and y on a drawing, or mass and x, y, z in the sensor's frame.

    Args:
        readings: a row a suspension: its point `x`, `y` (m) and the plumb line's `angle` to the x axis (rad); or a row
            an attitude: `fx` ... `tz` (N, N m) and gravity's direction `gx`, `gy`, `gz` in the same frame.
        rng: of the Monte Carlo propagation.

    Raises:
        UserError: too few lines or attitudes, or too alike.
    """
    if choose(readings, FORMS) == "suspensions":
        return _lines(readings, rng)
    wrench = np.column_stack([readings[c] for c in FORMS["attitudes"][:6]])
    down = np.column_stack([readings[c] for c in ("gx", "gy", "gz")])
    length = np.linalg.norm(down, axis=1)
    bad = np.flatnonzero(length < 1e-6)
    if len(bad):
        raise UserError("gravity has no direction", file=readings.file, key=f"row {bad[0] + 2}", expected="gx, gy, gz")
    return attitudes(wrench, down / length[:, None], rng, str(readings.file), readings)


def attitudes(
    wrench: np.ndarray, down: np.ndarray, rng: np.random.Generator, file: str, readings: Readings | None = None
) -> Outcome:
    """Mass and centre of mass from wrenches (n, 6) N, N m at rest, gravity's unit vectors (n, 3) in their frame.

    A sensor that reads what the flange exerts on the tool, not the reverse, gives a negative mass: it is turned round.

    Raises:
        UserError: fewer than four attitudes, or less than 30 degrees between all of them.
    """
    apart = max((np.arccos(np.clip(a @ b, -1, 1)) for a, b in combinations(down, 2)), default=0.0)
    spread = np.linalg.svd(down - down.mean(axis=0), compute_uv=False)
    if len(down) < ATTITUDES or apart < APART or spread[1] < 0.1 * np.sqrt(len(down)):
        got = f"{len(down)} of them, {np.degrees(apart):.0f} degrees apart at most"
        expected = f"{ATTITUDES} or more that tilt about two axes, {np.degrees(APART):.0f} degrees or more apart"
        raise UserError("attitudes that do not tell the centre of mass", file=file, expected=expected, got=got)
    g = GRAVITY * down
    x, (mass, cov, dof) = _least_squares(_force_design(g), wrench[:, :3].reshape(-1), 3)
    sign = -1.0 if mass < 0 else 1.0
    moment, cov_t, dof_t = _moment(g, wrench[:, 3:])
    m = Input("scatter of the forces", abs(mass), float(np.sqrt(cov)), "A", dof, "t")
    scale = rectangular("local gravity", LOCAL / GRAVITY)
    errors = (
        []
        if readings is None or not readings.accuracy.get("fz")
        else [
            rectangular("limit of error of the force sensor, relative", readings.accuracy["fz"] / (abs(mass) * GRAVITY))
        ]
    )
    results = [propagate("mass", "kg", lambda m, *e: m * (1 + sum(e)), [m, scale, *errors], rng, repeats=len(down))]
    for axis, first, u in zip("xyz", sign * moment, np.sqrt(cov_t), strict=True):
        inputs = [Input("scatter of the torques", float(first), float(u), "A", dof_t, "t"), m]
        results.append(propagate(f"com_{axis}", "m", lambda s, m: s / m, inputs, rng, repeats=len(down)))
    notes = ["the sensor reads what the flange exerts on the tool: signs turned round"] if sign < 0 else []
    bias = (sign * x[:3]).tolist()
    return Outcome(
        tuple(results), tuple(notes), {"force_bias_n": bias, "attitudes_apart_deg": float(np.degrees(apart))}
    )


def _force_design(g: np.ndarray) -> np.ndarray:
    """(3 n, 4): bias, then mass."""
    return np.concatenate([np.tile(np.eye(3), (len(g), 1)), g.reshape(-1, 1)], axis=1)


def _least_squares(design: np.ndarray, y: np.ndarray, column: int) -> tuple[np.ndarray, tuple[float, float, float]]:
    x, *_ = np.linalg.lstsq(design, y, rcond=None)
    dof = len(y) - design.shape[1]
    s2 = float(np.sum((y - design @ x) ** 2)) / dof
    return x, (float(x[column]), s2 * float(np.linalg.inv(design.T @ design)[column, column]), float(dof))


def _moment(g: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The moment m c (3,), its variances and their degrees of freedom from t = b + (m c) x g."""
    cross = np.array([[[0, gz, -gy], [-gz, 0, gx], [gy, -gx, 0]] for gx, gy, gz in g])  # s x g = cross s
    design = np.concatenate([np.tile(np.eye(3), (len(g), 1)), cross.reshape(-1, 3)], axis=1)
    y = torque.reshape(-1)
    x, *_ = np.linalg.lstsq(design, y, rcond=None)
    dof = len(y) - 6
    s2 = float(np.sum((y - design @ x) ** 2)) / dof
    return x[3:], s2 * np.diag(np.linalg.inv(design.T @ design))[3:], float(dof)


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
    """The point (x, y) nearest to all lines, of floats or arrays alike: 2x2 normal equations by Cramer's rule."""
    a = b = c = p = q = np.float64(0.0)
    for at in range(count):
        nx, ny = -np.sin(line["angle", at]), np.cos(line["angle", at])
        along = nx * line["x", at] + ny * line["y", at]
        a, b, c = a + nx * nx, b + nx * ny, c + ny * ny
        p, q = p + nx * along, q + ny * along
    det = a * c - b * b
    return (c * p - b * q) / det, (a * q - b * p) / det
