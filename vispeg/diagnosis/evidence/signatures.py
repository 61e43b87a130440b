"""Signatures: first-order change of the whitened residual when an effect is added at a place.

A whitened residual is (measured - predicted) / noise, flat over all readings. Null is the value of a parameter at which
its effect does nothing. A magnitude is a parameter whose null removes the effect (a friction torque); a shape is any
other (a width). A moment is a shape whose product with the magnitude enters linearly (the position of a mass).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.params import Param
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.localise import JointData
from vispeg.identify.channels import Item
from vispeg.identify.evidence import Evidence
from vispeg.worlds.world import World

WILD = 5e3  # whitened residual beyond which a rollout says nothing of its parameter
STEP = 0.05  # share of a moment's range by which its variant is shifted


@dataclass(frozen=True)
class Signature:
    """First-order effect of one candidate.

    Attributes:
        probe: the effect, with the values at which the signature was computed.
        names: magnitudes of the first columns; a coefficient of 1 means the probe's value, 0 null.
        moments: of the other columns; a moment's shift from the probe's value, in units of `STEP` of its range, is its
            coefficient over the magnitude's.
        columns: (n, k) drop of the whitened residual for a coefficient of 1.
    """

    probe: EffectInstance
    names: tuple[str, ...]
    columns: np.ndarray
    moments: tuple[str, ...] = ()

    @property
    def key(self) -> tuple[str, str]:
        """(effect, where)."""
        return self.probe.effect, self.probe.where

    @property
    def bounds(self) -> np.ndarray:
        """Least and greatest coefficients, (2, k)."""
        reach = [_reach(self.probe, name) for name in self.names]
        return np.array([*reach, *[(-np.inf, np.inf)] * len(self.moments)]).T

    def possible(self, coefficients: Sequence[float]) -> bool:
        """Return whether coefficients mean values within bounds, and no magnitude at a bound other than null."""
        kind, count = effect(self.probe.effect), len(self.names)
        low, high = self.bounds[:, :count]
        values = self.probe.params
        for m, a, b, c in zip(self.names, low, high, coefficients, strict=False):
            p = kind.params[m]
            if not a <= c <= b or _at_edge(p, p.null + c * (values[m].value - p.null)):
                return False
        for m, c in zip(self.moments, coefficients[count:], strict=False):
            p, shift = kind.params[m], STEP * c / max(abs(coefficients[0]), 1e-12)
            if not p.low < values[m].value + shift * (p.high - p.low) < p.high:
                return False
        return True

    def placed(self, coefficients: Sequence[float]) -> EffectInstance:
        """Return the effect with start values for a fit from the coefficients; magnitudes are kept away from null."""
        kind, values = effect(self.probe.effect), {}
        for m, c in zip(self.names, coefficients, strict=False):
            p, reach = kind.params[m], self.probe.params[m].value - kind.params[m].null
            if p.scale == "log" or kind.torqueless:  # no straight line leads from null to such a value: keep the guess
                values[m] = self.probe.params[m].value
                continue
            c = c if abs(c) > 0.02 else 0.02
            values[m] = float(np.clip(p.null + c * reach, p.low, p.high))
        scale = max(abs(coefficients[0]), 0.02)
        for m, c in zip(self.moments, coefficients[len(self.names) :], strict=False):
            p = kind.params[m]
            shifted = self.probe.params[m].value + STEP * (p.high - p.low) * c / scale
            values[m] = float(np.clip(shifted, p.low, p.high))
        return self.probe.with_values(**values)


@dataclass(frozen=True)
class Probe:
    """An effect at the values at which its signature is computed, and the parameters that are varied.

    Attributes:
        placed: the effect.
        names: its magnitudes that are not null.
        moments: its moments if it has a single such magnitude; else none.
    """

    placed: EffectInstance
    names: tuple[str, ...]
    moments: tuple[str, ...]

    @property
    def variants(self) -> list[EffectInstance]:
        """The effects to roll out: with each magnitude alone (the others at null), then with each moment shifted."""
        kind = effect(self.placed.effect)
        null = {name: kind.params[name].null for name in self.names}
        alone = [self.placed.with_values(**{o: v for o, v in null.items() if o != name}) for name in self.names]
        return alone + [_shifted(self.placed, m) for m in self.moments]


def probes(places: Sequence[tuple[str, str]], item: Item, joint_data: Sequence[JointData]) -> list[Probe]:
    """Return the probes of all these (effect, where): for each one as many as there are guesses of its values.

    `item` says which robot it is; `joint_data` has the data of each joint, from which values are guessed.
    """
    out = []
    for name, where in places:
        kind = effect(name)
        for placed in guessed(name, where, item, joint_data):
            names = tuple(m for m in kind.magnitudes if placed.params[m].value != kind.params[m].null)
            if names:
                out.append(Probe(placed, names, kind.moments if len(names) == 1 else ()))
    return out


def signatures(evidence: Evidence, world: World, residual: np.ndarray, probes: Sequence[Probe]) -> list[Signature]:
    """Return the change of the `residual` of `world` due to each probe."""
    return [*each_signature(evidence, world, residual, probes)]


def each_signature(
    evidence: Evidence, world: World, residual: np.ndarray, probes: Sequence[Probe]
) -> Iterator[Signature]:
    """Yield the signatures one by one; they are simulated with longer steps than fits (`Evidence.each_pair`)."""
    pairs = evidence.each_pair(world, residual, [world.add(v) for probe in probes for v in probe.variants])
    for probe in probes:
        columns = [_drop(*next(pairs)) for _ in probe.variants]
        count = len(probe.names)
        columns = columns[:count] + [c - columns[0] for c in columns[count:]]
        yield Signature(probe.placed, probe.names, np.stack(columns, axis=1), probe.moments)


def _drop(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return the drop of the whitened residual due to a parameter, 0 in entries in which its rollout diverged."""
    return np.where(np.abs(after) > WILD, 0.0, before - after).astype(np.float32)


def _shifted(probe: EffectInstance, moment: str) -> EffectInstance:
    p = effect(probe.effect).params[moment]
    return probe.with_values(**{moment: probe.params[moment].value + STEP * (p.high - p.low)})


def guessed(name: str, where: str, item: Item, joint_data: Sequence[JointData]) -> list[EffectInstance]:
    """Return an effect at a place with each guess of its values from the joint's data; empty if they rule it out.

    At a place that is no joint, it has typical values.
    """
    kind, joints = effect(name), item.robot.joints
    data = joint_data[joints.index(where)] if where in joints else None
    guesses = kind.guesses(data) if data is not None else [{}]
    out = []
    most = {} if data is None else _largest(data)
    for guess in guesses:
        values = {m: kind.params[m].start for m in kind.magnitudes}
        null = [m for m in values if kind.params[m].null == 0]
        values |= {m: min(values[m], most.get(kind.params[m].unit, np.inf)) for m in null}
        out.append(EffectInstance.of(name, where, **{**values, **guess}))
    return out


def _largest(data: JointData) -> dict[str, float]:
    """Map each unit to the largest value of a probe, so that no effect makes more torque than is missing.

    A typical value may be far too large: half a newton metre of friction, or a tenth of a kg m2 of rotor inertia, would
    stop a wrist, and that far from null no signature is linear.
    """
    stretch = data.q - np.median(data.q)
    return {"N m": data.missing, "N m s/rad": data.per(data.dq), "kg m2": data.inertia, "N m/rad": data.per(stretch)}


def at_bound(placed: EffectInstance) -> bool:
    """Return whether a magnitude of a fitted effect is at a bound other than null; usually another error pushed it."""
    kind = effect(placed.effect)
    return any(_at_edge(kind.params[name], placed.params[name].value) for name in kind.magnitudes)


def _at_edge(p: Param, value: float) -> bool:
    """Return whether a value is near a bound of its parameter that is not null."""
    value, low, high = (float(np.log(v)) if p.scale == "log" else v for v in (value, p.low, p.high))
    edge = RULES.edge * (high - low)
    return (value > high - edge and p.high != p.null) or (value < low + edge and p.low != p.null)


def _reach(probe: EffectInstance, name: str) -> tuple[float, float]:
    """Return the bounds of the coefficient that scales a magnitude's distance from null."""
    p = effect(probe.effect).params[name]
    reach = probe.params[name].value - p.null
    low, high = sorted(((p.low - p.null) / reach, (p.high - p.null) / reach))
    return low - 1e-9, high + 1e-9
