"""Friction of two surfaces: from the incline at which one begins to slide, the time to slide down, or the forces.

At the angle a at which sliding begins, mu_s = tan a. Sliding a distance d from rest in the time t gives
mu_k = tan a - 2 d / (g t^2 cos a) (Newton's second law along the incline). While sliding under a normal force,
mu_k = F_t / F_n.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.measure.outcome import Outcome, by_place, short
from vispeg.measure.readings import Readings, choose, digit_of, instrument_law, refuse_drift
from vispeg.measure.uncertainty import places, propagate

GRAVITY = 9.81  # m/s^2
REPEATS, PLACES = 10, 3  # numbers that the protocol asks for
FORMS = {  # form of the table -> its columns; `static` is last, as the timed form has its column too
    "kinetic, timed": ("angle", "distance", "time"),
    "kinetic, by forces": ("normal", "tangential"),
    "static": ("angle",),
}


def _timed(angle, distance, time):
    """Return mu of a slide from rest: rad, m, s; floats or arrays."""
    return np.tan(angle) - 2.0 * distance / (GRAVITY * time**2 * np.cos(angle))


# form -> mu from its columns, the quantity's name
FUNCTIONS: dict[str, tuple[Callable[..., Any], str]] = {
    "kinetic, timed": (_timed, "kinetic_friction"),
    "kinetic, by forces": (lambda normal, tangential: tangential / normal, "kinetic_friction"),
    "static": (np.tan, "static_friction"),
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
    if "angle" in FORMS[form]:
        _check_angles(readings)
    columns, (function, name) = FORMS[form], FUNCTIONS[form]
    with np.errstate(divide="ignore", invalid="ignore"):  # of a force or time of 0, which is refused below
        values = function(*(readings[column] for column in columns))
    bad = np.flatnonzero(~(np.isfinite(values) & (values > 0)))
    if len(bad):
        raise UserError("gives no coefficient of friction above 0", file=readings.file, key=readings.row(bad[0]))
    place = readings.place()
    mean = places(name.replace("_", " "), values, place)
    errors, law = instrument_law(readings, columns, function)
    nominal = law(*(0.0 for _ in errors))  # at the mean readings; only the change by the errors is added to `mean`
    if place is None:
        refuse_drift(values, digit_of(readings, columns, function), readings.file, "friction")
    result = propagate(name, "1", lambda mu, *off: mu + law(*off) - nominal, [mean, *errors], rng, repeats=len(values))
    count, lacking = (1, "place") if place is None else (len(np.unique(place)), "")
    notes = [*short(len(values), REPEATS, "slide"), *short(count, PLACES, "place", lacking)]
    return Outcome((result,), tuple(notes), by_place(values, place))


def _check_angles(readings: Readings) -> None:
    """Raise UserError if an angle is not between 0 and 90 degrees."""
    angle = readings["angle"]
    bad = np.flatnonzero((angle <= 0) | (angle >= np.pi / 2))
    if len(bad):
        got = f"{angle[bad[0]]:.4g} rad"
        key, expected = f"{readings.row(bad[0])}, column angle", "an angle between 0 and 90 degrees: rad, or angle_deg"
        raise UserError("is not an incline", file=readings.file, key=key, expected=expected, got=got)
