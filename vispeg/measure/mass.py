"""Mass: the mean of weighings, each minus the reading of the empty scale if there is a column `tare`."""

from __future__ import annotations

import numpy as np

from vispeg.core.errors import UserError
from vispeg.measure.outcome import Outcome, short
from vispeg.measure.readings import Readings, choose, refuse_drift
from vispeg.measure.uncertainty import propagate, repeated

FORMS = {"weighing": ("mass",)}
WEIGHINGS = 5  # number that the protocol asks for


def measure(readings: Readings, rng: np.random.Generator) -> Outcome:
    """Compute the mass in kg.

    Args:
        readings: `mass` (kg), and optionally `tare` (kg), the reading of the empty scale before each.
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
        raise UserError("is not a mass", file=readings.file, key=key, expected=expected, got=float(net[bad[0]]))
    inputs = [repeated("repeats", net), *readings.instrument("mass")]
    if tare is not None:
        inputs += readings.instrument("tare") if "tare" in readings.resolution else readings.instrument("mass")[:1]
    refuse_drift(net, readings.resolution["mass"], readings.file, "mass")
    result = propagate("mass", "kg", lambda *x: sum(x), inputs, rng, repeats=len(net))
    return Outcome((result,), tuple(short(len(net), WEIGHINGS, "weighing")))
