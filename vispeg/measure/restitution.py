"""Restitution: from the heights of drop and bounce, or from the times between bounces.

e = sqrt(h_bounce / h_drop). Between two touches an object flies for t = 2 v / g, so e is also the ratio of two
consecutive flight times, which depends neither on the clock's scale nor on the height of the drop.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.errors import UserError
from vispeg.measure.outcome import Outcome, short
from vispeg.measure.readings import Readings, choose, instrument_law
from vispeg.measure.uncertainty import places, propagate

FORMS = {
    "times of three touches": ("t1", "t2", "t3"),
    "times of two flights": ("flight1", "flight2"),
    "heights": ("drop", "bounce"),
}
DROPS, HEIGHTS = 10, 2  # numbers of drops and of different heights that the protocol asks for
BY_HAND = 0.01  # m, distance up to which drops count as of one height, if no accuracy of `drop` is stated


def measure(readings: Readings, rng: np.random.Generator) -> Outcome:
    """Compute the coefficient of restitution.

    Args:
        readings: `t1`, `t2`, `t3` (s), times of three touches; or `flight1`, `flight2` (s); or `drop` and `bounce`
            (m). With times, optionally `drop` (m) to distinguish several heights.
        rng: of the Monte Carlo propagation.

    Raises:
        UserError: a row whose coefficient is not within 0 to 1, or a resolution that is not stated.
    """
    form = choose(readings, FORMS)
    if form == "heights":
        read, function = ("drop", "bounce"), lambda drop, bounce: np.sqrt(np.maximum(bounce / drop, 0.0))
    elif form == "times of two flights":
        read, function = ("flight1", "flight2"), lambda first, second: second / first
    else:
        read, function = ("t1", "t2", "t3"), lambda t1, t2, t3: (t3 - t2) / (t2 - t1)
    with np.errstate(all="ignore"):
        values = function(*(readings[column] for column in read))
    bad = np.flatnonzero(~(np.isfinite(values) & (values > 0) & (values <= 1)))
    if len(bad):
        got = float(values[bad[0]])
        raise UserError("is not a bounce", file=readings.file, key=readings.row(bad[0]), expected="0 < e <= 1", got=got)
    drop = readings.columns.get("drop")
    groups = None if drop is None else _heights(drop, 2.0 * readings.accuracy.get("drop", 0.0) or BY_HAND)
    mean = places("restitution", values, groups)
    errors, law = instrument_law(readings, read, function)
    nominal = law(*(0.0 for _ in errors))
    result = propagate(
        "restitution", "1", lambda e, *off: e * law(*off) / nominal, [mean, *errors], rng, repeats=len(values)
    )
    count, lacking = (1, "drop") if groups is None else (len(np.unique(groups)), "")
    notes = [*short(len(values), DROPS, "drop"), *short(count, HEIGHTS, "height", lacking)]
    rows = []
    for height in () if groups is None else np.unique(groups):
        v = values[groups == height]
        rows.append({"drop_m": float(height), "mean": float(v.mean()), "repeats": len(v)})
    return Outcome((result,), tuple(notes), {"heights": rows} if rows else {})


def _heights(drop: np.ndarray, apart: float) -> np.ndarray:
    """Group drops (n,) m of about equal height, and return for each the mean height (n,) m of its group.

    In sorted order, a new group begins after a difference of more than `apart` m.
    """
    order = np.argsort(drop)
    number = np.concatenate([[0], np.cumsum(np.diff(drop[order]) > apart)])
    out = np.empty(len(drop))
    for k in np.unique(number):
        out[order[number == k]] = drop[order[number == k]].mean()
    return out
