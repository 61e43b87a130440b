"""Friction of two surfaces: from the incline at which one begins to slide, the time to slide down, or the forces.

At the angle a at which sliding begins, mu_s = tan a. Sliding a distance d from rest in the time t gives
mu_k = tan a - 2 d / (g t^2 cos a) (Newton's second law along the incline). While sliding under a normal force,
mu_k = F_t / F_n.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.core.errors import UserError
from vispeg.measure.outcome import Outcome, by_place, short
from vispeg.measure.readings import Readings, choose, instrument_law, refuse_drift
from vispeg.measure.uncertainty import places, propagate

GRAVITY = 9.81  # m/s^2
REPEATS, PLACES = 10, 3  # numbers that the protocol asks for
FORMS = {
    "kinetic, timed": ("angle", "distance", "time"),
    "kinetic, by forces": ("normal", "tangential"),
    "static": ("angle",),
}


def measure(readings: Readings, rng: np.random.Generator) -> Outcome:
    """Compute the coefficient of friction, static or kinetic depending on the columns.

    Args:
        readings: `angle` (rad) for static friction; `angle`, `distance` (m) and `time` (s), or `normal` and
            `tangential` (N), for kinetic friction; optionally `place`.
        rng: of the Monte Carlo propagation.

    Raises:
        UserError: an angle outside (0, 90) degrees, a row that gives no coefficient above 0, a drift, or a resolution
            that is not stated.
    """
    form = choose(readings, FORMS)
    if form == "kinetic, by forces":  # the tangential force changes its sign with the direction of sliding
        sizes = {name: np.abs(readings[name]) for name in ("normal", "tangential")}
        readings = replace(readings, columns={**readings.columns, **sizes})
    values, read, function, name = _forms(form, readings)
    if not (np.isfinite(values) & (values > 0)).all():
        row = int(np.flatnonzero(~(np.isfinite(values) & (values > 0)))[0])
        raise UserError("gives no coefficient of friction above 0", file=readings.file, key=readings.row(row))
    place = readings.place()
    mean = places(name.replace("_", " "), values, place)
    errors, law = instrument_law(readings, read, function)
    nominal = law(*(0.0 for _ in errors))
    if place is None:
        refuse_drift(values, 0.0, readings.file, "friction")
    result = propagate(name, "1", lambda mu, *off: mu + law(*off) - nominal, [mean, *errors], rng, repeats=len(values))
    count, unsaid = (1, "place") if place is None else (len(np.unique(place)), "")
    notes = [*short(len(values), REPEATS, "slide"), *short(count, PLACES, "place", unsaid)]
    return Outcome((result,), tuple(notes), by_place(values, place))


def _forms(form: str, r: Readings):
    """Return how a form of the table gives mu.

    Returns:
        mu of each row (n,); the columns that instruments read; the function from these to mu; the quantity's name.
    """
    if form == "static":
        return _angles(r, np.tan), ("angle",), np.tan, "static_friction"
    if form == "kinetic, timed":

        def timed(angle, distance, time):
            return np.tan(angle) - 2.0 * distance / (GRAVITY * time**2 * np.cos(angle))

        values = _angles(r, lambda angle: timed(angle, r["distance"], r["time"]))
        return values, ("angle", "distance", "time"), timed, "kinetic_friction"
    return r["tangential"] / r["normal"], ("normal", "tangential"), lambda n, t: t / n, "kinetic_friction"


def _angles(r: Readings, function):
    angle = r["angle"]
    bad = np.flatnonzero((angle <= 0) | (angle >= np.pi / 2))
    if len(bad):
        got = f"{angle[bad[0]]:.4g} rad"
        key, expected = f"{r.row(bad[0])}, column angle", "an angle between 0 and 90 degrees: rad, or angle_deg"
        raise UserError("is not an incline", file=r.file, key=key, expected=expected, got=got)
    return function(angle)
