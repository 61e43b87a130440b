"""Score test over the whole library: how much of the residual each effect, at each place, could explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from vispeg.core.effect import EffectInstance, effect, searchable
from vispeg.diagnosis.localise import JointData
from vispeg.identify.channels import Item
from vispeg.identify.evidence import Evidence
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Score:
    """One candidate.

    Attributes:
        placed: the effect with the values at which a fit should start.
        gain: drop of the squared whitened residual that its signature explains to first order.
    """

    placed: EffectInstance
    gain: float

    @property
    def key(self) -> tuple[str, str]:
        """(effect, where)."""
        return self.placed.effect, self.placed.where


def candidates(evidence: Evidence, world: World, joints: Sequence[str]) -> list[tuple[str, str]]:
    """Every (effect, place) of the library that is not yet in the world; joint places only among `joints`."""
    taken = {(e.effect, e.where) for e in world.effects}
    item, out = evidence.items[0], []
    for name, kind in searchable().items():
        if not evidence.sees(kind):
            continue
        places = [t for t in kind.targets(item.robot) if t not in item.robot.joints or t in joints or kind.torqueless]
        if kind.shared:
            places.append("all")
        everywhere = (name, "all") in taken
        out += [(name, place) for place in places if (name, place) not in taken and not everywhere]
    return out


def screen(
    evidence: Evidence,
    world: World,
    residual: np.ndarray,
    jacobian: np.ndarray | None,
    places: Sequence[tuple[str, str]],
    joint_data: Sequence[JointData],
) -> list[Score]:
    """Scores of all places, best first. `residual` and `jacobian` belong to `world` on the same evidence."""
    probes: list[tuple[EffectInstance, list[str]]] = []  # a probe and the magnitudes that it varies
    rows: list[World] = []
    for name, where in places:
        for probe in _probes(name, where, evidence.items[0], joint_data):
            kind = effect(name)
            names = [m for m in kind.magnitudes if probe.params[m].value != kind.params[m].null]
            probes.append((probe, names))
            for m in names:
                others = {o: kind.params[o].null for o in names if o != m}
                rows.append(world.add(probe.with_values(**others)))
    basis = _orthonormal(jacobian, len(residual))
    base = residual - basis @ (basis.T @ residual)
    best: dict[tuple[str, str], Score] = {}
    at = 0
    chunk = 96
    columns: list[np.ndarray] = []
    for start in range(0, len(rows), chunk):
        for r in evidence.residuals(rows[start : start + chunk]):
            s = (residual - r).astype(np.float32)
            s[np.abs(r) > 5e3] = 0.0
            columns.append(s)
    for probe, names in probes:
        score = _score(probe, names, np.stack(columns[at : at + len(names)], axis=1).astype(float), base, basis)
        at += len(names)
        if score is not None and (score.key not in best or score.gain > best[score.key].gain):
            best[score.key] = score
    return sorted(best.values(), key=lambda s: -s.gain)


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


def _orthonormal(jacobian: np.ndarray | None, n: int) -> np.ndarray:
    if jacobian is None or jacobian.shape[1] == 0:
        return np.zeros((n, 0))
    return np.linalg.qr(jacobian)[0]


def _score(probe: EffectInstance, names: list[str], s: np.ndarray, base: np.ndarray, basis: np.ndarray) -> Score | None:
    if not names:
        return None
    if basis.shape[1]:
        s = s - basis @ (basis.T @ s)
    norm = np.linalg.norm(s, axis=0)
    if np.all(norm < 1e-6):
        return None
    kind = effect(probe.effect)
    low, high = [], []
    for m in names:  # the coefficient scales the distance from null, inside the parameter's bounds
        p, reach = kind.params[m], probe.params[m].value - kind.params[m].null
        ends = sorted(((p.low - p.null) / reach, (p.high - p.null) / reach))
        low.append(ends[0] - 1e-9)
        high.append(ends[1] + 1e-9)
    q, r = np.linalg.qr(s)
    fit = lsq_linear(r, q.T @ base, bounds=(low, high))
    explained = s @ fit.x
    gain = float(base @ base - np.sum((base - explained) ** 2))
    if gain <= 0 or not np.any(explained):
        return None
    values = {}
    for m, c in zip(names, fit.x, strict=True):
        p, reach = kind.params[m], probe.params[m].value - kind.params[m].null
        if p.scale == "log" or kind.torqueless:  # no line leads from null to such a value: the guess stands
            values[m] = probe.params[m].value
            continue
        c = c if abs(c) > 0.02 else 0.02
        values[m] = float(np.clip(p.null + c * reach, p.low, p.high))
    return Score(probe.with_values(**values), gain)
