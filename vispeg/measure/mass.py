"""Mass: the mean of weighings, each minus the reading of the empty scale if there is a column `tare`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.core.errors import UserError
from vispeg.measure.outcome import Outcome, short
from vispeg.measure.readings import Readings, choose, digit_of, refuse_drift
from vispeg.measure.uncertainty import propagate, repeated

FORMS = {"weighing": ("mass",)}
WEIGHINGS = 5  # number that the protocol asks for


def measure(readings: Readings, rng: np.random.Generator) -> Outcome:
    """Compute the mass in kg.

    Args:
        readings: `mass` (kg), and optionally `tare` (kg), the reading of the empty scale before each, of the same
            resolution unless its own is stated.
        rng: of the Monte Carlo propagation.

    Raises:
        UserError: a mass that is not above 0, a drift, or a resolution that is not stated.
    """
    choose(readings, FORMS)
    tare = readings.columns.get("tare")
    net = readings["mass"] - (0.0 if tare is None else tare)
    bad = np.flatnonzero(net <= 0)
    if len(bad):
        key = f"{readings.row(bad[0])}, column mass"
        expected = "above 0 kg" + (" when the tare is taken off" if tare is not None else "")
        raise UserError("is not a mass", file=readings.file, key=key, expected=expected, got=f"{net[bad[0]]:.6g}")
    inputs, digit = [repeated("repeats", net), *readings.instrument("mass")], readings.resolution["mass"]
    if tare is not None:
        readings = replace(readings, resolution={"tare": digit, **readings.resolution})
        inputs += readings.instrument("tare")
        digit = digit_of(readings, ("mass", "tare"), np.subtract)
    refuse_drift(net, digit, readings.file, "mass")
    result = propagate("mass", "kg", lambda *x: sum(x), inputs, rng, repeats=len(net))
    return Outcome((result,), tuple(short(len(net), WEIGHINGS, "weighing")))
