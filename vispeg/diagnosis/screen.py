"""Score test over the whole library: how much of the residual each effect, at each place, could explain."""

from __future__ import annotations

from collections.abc import Collection, Sequence
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
        beside: the other members where a group is tried at once.
    """

    placed: EffectInstance
    gain: float
    beside: tuple[EffectInstance, ...] = ()

    @property
    def members(self) -> tuple[EffectInstance, ...]:
        """All that is tried."""
        return (self.placed, *self.beside)

    @property
    def count(self) -> int:
        """Number of members."""
        return 1 + len(self.beside)

    @property
    def key(self) -> tuple[str, str]:
        """(effect, where); of a group its effects, and `each`."""
        if not self.beside:
            return self.placed.effect, self.placed.where
        return " + ".join(dict.fromkeys(e.effect for e in self.members)), "each"

    @property
    def label(self) -> str:
        """`coulomb_friction(joint4)`, or `coulomb_friction + viscous_friction(each)`."""
        return "{}({})".format(*self.key)

    def has(self, placed: EffectInstance) -> bool:
        """Whether an effect at its place is one of the members."""
        return any((e.effect, e.where) == (placed.effect, placed.where) for e in self.members)


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


def groups(evidence: Evidence, world: World, done: Collection[str] = ()) -> list[list[tuple[str, str]]]:
    """What every arm has in every joint and this world has not yet, by kind: friction, rotor inertia, bias.

    Kinds (`Effect.common`) that are `done` are not asked for again.
    """
    found: dict[str, list[tuple[str, str]]] = {}
    for name, place in candidates(evidence, world, evidence.items[0].robot.joints):
        common = effect(name).common
        if common and common not in done and place != "all":
            found.setdefault(common, []).append((name, place))
    return [places for places in found.values() if len(places) > 1]


def screen(
    evidence: Evidence,
    world: World,
    residual: np.ndarray,
    jacobian: np.ndarray | None,
    places: Sequence[tuple[str, str]],
    joint_data: Sequence[JointData],
    together: Sequence[Sequence[tuple[str, str]]] = (),
) -> list[Score]:
    """Scores of all places and of the groups `together`, best first.

    `residual` and `jacobian` belong to `world` on the same evidence.
    """
    single = set(places)
    places = list(dict.fromkeys([*places, *(p for group in together for p in group)]))
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
    seen: dict[tuple[str, str], tuple[EffectInstance, np.ndarray]] = {}
    for probe, names in probes:
        key, s = (probe.effect, probe.where), np.stack(columns[at : at + len(names)], axis=1).astype(float)
        at += len(names)
        seen[key] = probe, s
        score = _score(probe, names, s, base, basis) if key in single else None
        if score is not None and (score.key not in best or score.gain > best[score.key].gain):
            best[score.key] = score
    tried = [_group_score([seen[p] for p in group if p in seen], base, basis) for group in together]
    return sorted([*best.values(), *(g for g in tried if g is not None)], key=lambda s: -s.gain)


def _group_score(members: list[tuple[EffectInstance, np.ndarray]], base: np.ndarray, basis: np.ndarray) -> Score | None:
    """The score of effects of one magnitude each that are tried at once."""
    members = [(probe, s) for probe, s in members if s.shape[1] == 1 and np.linalg.norm(s) > 1e-6]
    if len(members) < 2:
        return None
    names = [effect(probe.effect).magnitudes for probe, _ in members]
    bounds = [_reach(probe, name[0]) for (probe, _), name in zip(members, names, strict=True)]
    s = np.concatenate([s for _, s in members], axis=1)
    s = s - basis @ (basis.T @ s)
    fit = lsq_linear(*_projected(s, base), bounds=tuple(zip(*bounds, strict=True)))
    gain = float(base @ base - np.sum((base - s @ fit.x) ** 2))
    values = [
        probe.with_values(**_started(probe, name[:1], [c]))
        for (probe, _), name, c in zip(members, names, fit.x, strict=True)
    ]
    return Score(values[0], gain, tuple(values[1:])) if gain > 0 else None


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
    low, high = zip(*(_reach(probe, m) for m in names), strict=True)
    fit = lsq_linear(*_projected(s, base), bounds=(low, high))
    explained = s @ fit.x
    gain = float(base @ base - np.sum((base - explained) ** 2))
    if gain <= 0 or not np.any(explained):
        return None
    return Score(probe.with_values(**_started(probe, names, fit.x)), gain)


def _projected(s: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same least-squares problem with as few rows as columns."""
    q, r = np.linalg.qr(s)
    return r, q.T @ base


def _reach(probe: EffectInstance, name: str) -> tuple[float, float]:
    """Bounds of the coefficient that scales a magnitude's distance from null."""
    p = effect(probe.effect).params[name]
    reach = probe.params[name].value - p.null
    low, high = sorted(((p.low - p.null) / reach, (p.high - p.null) / reach))
    return low - 1e-9, high + 1e-9


def _started(probe: EffectInstance, names: Sequence[str], coefficients: Sequence[float]) -> dict[str, float]:
    """Values at which a fit should start."""
    kind, values = effect(probe.effect), {}
    for m, c in zip(names, coefficients, strict=True):
        p, reach = kind.params[m], probe.params[m].value - kind.params[m].null
        if p.scale == "log" or kind.torqueless:  # no line leads from null to such a value: the guess stands
            values[m] = probe.params[m].value
            continue
        c = c if abs(c) > 0.02 else 0.02
        values[m] = float(np.clip(p.null + c * reach, p.low, p.high))
    return values
