"""Test whether a robot has changed since identification: refit its named effects to each recording.

Each value is tested by z = (now - then) / sqrt(s_now^2 + s_then^2), where s is the width of the 95 % interval over
3.92, with Holm's procedure over all values and recordings. A whitened residual is an error divided by its noise. If its
mean square in a recording is above 1, the intervals from that recording are widened by the root of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypedDict

import numpy as np
from scipy.stats import norm

from vispeg.core.effect import effect
from vispeg.core.holm import holm
from vispeg.core.params import Value
from vispeg.core.rules import RULES
from vispeg.identify.calibrate import calibrate
from vispeg.identify.inverse import evidence_for
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World

WIDTH = 2 * float(norm.ppf(0.975))  # standard deviations in a 95 % interval
LAPS = 4  # most points that least squares evaluates, with the model's values; an unchanged robot needs one step


class Ends(TypedDict):
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float


class Now(Ends):
    """A value fitted to one recording: the adjusted p-value of no change, and whether it has changed (`outside`)."""

    recording: str
    p_holm: float
    outside: bool


class Drift(TypedDict):
    """One value of an identified effect: at identification, and in each recording.

    `since` is the first recording from which on the value is changed in every one; None if it is not in the last.
    """

    effect: str
    where: str
    parameter: str
    unit: str
    then: Ends
    now: list[Now]
    since: str | None


def named(world: World) -> list[int]:
    """Return the indices of an arm's identified effects: those with an interval, in which the residual is smooth."""
    return [
        i for i, e in enumerate(world.effects) if effect(e.effect).smooth and any(_known(v) for v in e.params.values())
    ]


def drifts(world: World, recordings: Sequence[Recording], threads: int) -> list[Drift]:
    """Fit the identified effects of an arm's model to each recording, and compare the values with the model's.

    A value without an interval, in the model or in one of the fits, is left out.

    Args:
        world: of the arm, with intervals where effects were identified.
        recordings: in the order in which they were made.
        threads: of the simulation.
    """
    free = named(world)
    if not free:
        return []
    fitted: list[World] = []
    for rec in recordings:
        evidence = evidence_for([rec], threads)
        fit = calibrate(evidence, world, free, seed=0, method="least-squares", iterations=LAPS).fit
        fitted.append(_widened(fit.world, free, max(fit.cost, 1.0) ** 0.5))
    rows: list[Drift] = []
    for i in free:
        then = world.effects[i]
        for name, was in then.params.items():
            values = [w.effects[i].params[name] for w in fitted]
            if not _known(was) or not all(map(_known, values)):
                continue
            rows.append(
                {
                    "effect": then.effect,
                    "where": then.where,
                    "parameter": name,
                    "unit": effect(then.effect).params[name].unit,
                    "then": _ends(was),
                    "now": [
                        {"recording": rec.name, **_ends(v), "p_holm": _p(was, v), "outside": False}
                        for rec, v in zip(recordings, values, strict=True)
                    ],
                    "since": None,
                }
            )
    entries = [n for row in rows for n in row["now"]]
    for n, p in zip(entries, holm([n["p_holm"] for n in entries]), strict=True):
        n["p_holm"], n["outside"] = p, p < RULES.changed
    for row in rows:
        inside = [k for k, n in enumerate(row["now"]) if not n["outside"]]
        first = inside[-1] + 1 if inside else 0
        row["since"] = row["now"][first]["recording"] if first < len(row["now"]) else None
    return rows


def _known(v: Value) -> bool:
    """Return whether a value has an interval."""
    return v.low is not None and v.high is not None and v.high > v.low


def _ends(v: Value) -> Ends:
    assert v.low is not None and v.high is not None
    return {"value": v.value, "low": v.low, "high": v.high}


def _sd(v: Value) -> float:
    """Return the standard deviation that the 95 % interval implies."""
    ends = _ends(v)
    return (ends["high"] - ends["low"]) / WIDTH


def _p(then: Value, now: Value) -> float:
    """Return the two-sided p-value of no change."""
    return float(2 * norm.sf(abs(now.value - then.value) / np.hypot(_sd(then), _sd(now))))


def _widened(world: World, free: Sequence[int], factor: float) -> World:
    """Return the world with the intervals of some effects scaled by `factor` around their values."""
    effects = list(world.effects)
    for i in free:
        params = dict(effects[i].params)
        for k, v in params.items():
            if _known(v):
                ends = _ends(v)
                params[k] = Value(v.value, *(v.value + factor * (ends[end] - v.value) for end in ("low", "high")))
        effects[i] = replace(effects[i], params=params)
    return replace(world, effects=tuple(effects))
