"""Signatures: what each effect, at each place, would add to the whitened residual, to first order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.localise import JointData
from vispeg.identify.channels import Item
from vispeg.identify.evidence import Evidence
from vispeg.worlds.world import World

WILD = 5e3  # whitened residual beyond which a rollout says nothing about its parameter
EDGE = 0.005  # of a range, from a bound: a value so close stands at it
STEP = 0.05  # of a moment's range, by which it is shifted


@dataclass(frozen=True)
class Signature:
    """What one candidate adds.

    Attributes:
        probe: the effect, with the values at which the signature was taken.
        names: the magnitudes that scale the first columns: a coefficient of 1 is the probe's value, 0 its null.
        moments: the shapes that scale the others: of a coefficient over the first one's, in steps of `STEP`.
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
        """(2, k) least and greatest coefficients."""
        reach = [_reach(self.probe, name) for name in self.names]
        return np.array([*reach, *[(-np.inf, np.inf)] * len(self.moments)]).T

    def possible(self, coefficients: Sequence[float]) -> bool:
        """Whether every value that these coefficients mean lies inside its bounds, and none at one of them."""
        kind, count = effect(self.probe.effect), len(self.names)
        low, high = self.bounds[:, :count]
        inside = [a + EDGE * (b - a) < c < b - EDGE * (b - a) or abs(c) < EDGE
                  for a, b, c in zip(low, high, coefficients, strict=False)]  # fmt: skip
        shifts = {m: STEP * c / max(abs(coefficients[0]), 1e-12)
                  for m, c in zip(self.moments, coefficients[count:], strict=False)}  # fmt: skip
        for m, shift in shifts.items():
            p = kind.params[m]
            inside.append(p.low < self.probe.params[m].value + shift * (p.high - p.low) < p.high)
        return all(inside)

    def placed(self, coefficients: Sequence[float]) -> EffectInstance:
        """The effect with the values at which a fit should start."""
        kind, values = effect(self.probe.effect), {}
        for m, c in zip(self.names, coefficients, strict=False):
            p, reach = kind.params[m], self.probe.params[m].value - kind.params[m].null
            if p.scale == "log" or kind.torqueless:  # no line leads from null to such a value: the guess stands
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


def signatures(
    evidence: Evidence,
    world: World,
    residual: np.ndarray,
    places: Sequence[tuple[str, str]],
    joint_data: Sequence[JointData],
) -> list[Signature]:
    """The signatures of all these (effect, where) beside `world`, whose residual is `residual`; some have several."""
    probes: list[tuple[EffectInstance, list[str], tuple[str, ...]]] = []
    rows: list[World] = []
    for name, where in places:
        for probe in _probes(name, where, evidence.items[0], joint_data):
            kind = effect(name)
            names = [m for m in kind.magnitudes if probe.params[m].value != kind.params[m].null]
            if not names:
                continue
            moments = kind.moments if len(names) == 1 else ()
            probes.append((probe, names, moments))
            for m in names:
                others = {o: kind.params[o].null for o in names if o != m}
                rows.append(world.add(probe.with_values(**others)))
            rows += [world.add(_shifted(probe, m)) for m in moments]
    after = evidence.each_residual(rows)
    out = []
    for probe, names, moments in probes:
        columns = [_drop(residual, next(after)) for _ in (*names, *moments)]
        columns = columns[: len(names)] + [c - columns[0] for c in columns[len(names) :]]
        out.append(Signature(probe, tuple(names), np.stack(columns, axis=1), moments))
    return out


def _drop(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """What a parameter takes off a whitened residual; nothing where its rollout ran wild."""
    return np.where(np.abs(after) > WILD, 0.0, before - after).astype(np.float32)


def _shifted(probe: EffectInstance, moment: str) -> EffectInstance:
    p = effect(probe.effect).params[moment]
    return probe.with_values(**{moment: probe.params[moment].value + STEP * (p.high - p.low)})


def _probes(name: str, where: str, item: Item, joint_data: Sequence[JointData]) -> list[EffectInstance]:
    kind, joints = effect(name), item.robot.joints
    data = joint_data[joints.index(where)] if where in joints else None
    guesses = kind.guesses(data) if data is not None else [{}]
    out = []
    # No torque is missing that is greater than what is missing: half a newton metre of friction would stop a wrist.
    most = np.inf if data is None else max(float(np.quantile(np.abs(data.excess), 0.9)), 1e-3)
    for guess in guesses:
        values = {m: kind.params[m].start for m in kind.magnitudes}
        torques = [m for m in values if kind.params[m].unit == "N m" and kind.params[m].null == 0]
        values |= {m: min(values[m], most) for m in torques}
        out.append(EffectInstance.of(name, where, **{**values, **guess}))
    return out


def _reach(probe: EffectInstance, name: str) -> tuple[float, float]:
    """Bounds of the coefficient that scales a magnitude's distance from null."""
    p = effect(probe.effect).params[name]
    reach = probe.params[name].value - p.null
    low, high = sorted(((p.low - p.null) / reach, (p.high - p.null) / reach))
    return low - 1e-9, high + 1e-9
