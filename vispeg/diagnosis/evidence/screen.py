"""Score test over the whole library: the part of the residual that each effect, at each place, can explain."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.optimize import lsq_linear

from vispeg.core.effect import effect, searchable
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.signatures import Signature
from vispeg.diagnosis.findings import Score
from vispeg.identify.evidence import Evidence
from vispeg.worlds.world import World

ROWS = 2**16  # rows of a least-squares problem factorised at a time


def candidates(evidence: Evidence, world: World, joints: Sequence[str]) -> list[tuple[str, str]]:
    """Return every (effect, place) of the library that the world does not have; joint places only among `joints`."""
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
    """Return groups of effects that every arm has in all joints and the world lacks: friction, rotor inertia, bias.

    There is one group per kind (`Effect.common`), except those in `done`.
    """
    places_by_effect: dict[str, list[tuple[str, str]]] = {}
    for name, place in candidates(evidence, world, evidence.items[0].robot.joints):
        common = effect(name).common
        if common and common not in done and place != "all":
            places_by_effect.setdefault(common, []).append((name, place))
    return [places for places in places_by_effect.values() if len(places) > 1]


def shortlist(scores: Sequence[Score], best: int) -> list[Score]:
    """Return the `best` scores, without those below `fitted_share` of the largest gain beyond the first few."""
    top = scores[0].gain if scores else 0.0
    least = RULES.fitted_share * top
    return [s for i, s in enumerate(scores) if i < best and (i < RULES.fitted_surely or s.gain > least)]


def screen(
    taken: Sequence[Signature],
    residual: np.ndarray,
    jacobian: np.ndarray | None,
    places: Sequence[tuple[str, str]],
    together: Sequence[Sequence[tuple[str, str]]] = (),
) -> list[Score]:
    """Score all places and the groups `together` with the signatures `taken`; best first.

    `residual` and `jacobian` are those of the world at which the signatures were taken, on the same evidence.
    """
    single, grouped = set(places), {p for group in together for p in group}
    basis = _orthonormal(jacobian, len(residual))
    base = residual - basis @ (basis.T @ residual)
    best: dict[tuple[str, str], Score] = {}
    of: dict[tuple[str, str], tuple[float, Signature]] = {}  # best signature at each place
    for signature in taken:
        key = signature.key
        score = _score(signature, base, basis) if key in single or key in grouped else None
        gain = 0.0 if score is None else score.gain
        if key not in of or gain > of[key][0]:
            of[key] = gain, signature
        if score is not None and key in single and (key not in best or gain > best[key].gain):
            best[key] = score
    tried = [_group_score([of[p][1] for p in group if p in of], base, basis) for group in together]
    return sorted([*best.values(), *(g for g in tried if g is not None)], key=lambda s: -s.gain)


def _group_score(members: list[Signature], base: np.ndarray, basis: np.ndarray) -> Score | None:
    """Score a group of effects that are added together, each with its magnitudes."""
    members = [m for m in members if np.linalg.norm(m.columns[:, : len(m.names)]) > 1e-6]
    if len(members) < 2:
        return None
    counts = [len(m.names) for m in members]
    s = np.concatenate([m.columns[:, :n] for m, n in zip(members, counts, strict=True)], axis=1, dtype=float)
    s -= basis @ (basis.T @ s)
    bounds = np.concatenate([m.bounds[:, :n] for m, n in zip(members, counts, strict=True)], axis=1)
    fit = lsq_linear(*_projected(s, base), bounds=bounds)
    gain = float(base @ base - np.sum((base - s @ fit.x) ** 2))
    parts = np.split(fit.x, np.cumsum(counts)[:-1])
    values = [m.probe.with_values(**_magnitudes(m, x)) for m, x in zip(members, parts, strict=True)]
    return Score(values[0], gain, tuple(values[1:])) if gain > 0 else None


def _orthonormal(jacobian: np.ndarray | None, n: int) -> np.ndarray:
    if jacobian is None or jacobian.shape[1] == 0:
        return np.zeros((n, 0))
    return np.linalg.qr(jacobian)[0]


def _score(signature: Signature, base: np.ndarray, basis: np.ndarray) -> Score | None:
    count = len(signature.names)
    s = signature.columns[:, :count].astype(float)
    if basis.shape[1]:
        s = s - basis @ (basis.T @ s)
    norm = np.linalg.norm(s, axis=0)
    if np.all(norm < 1e-6):
        return None
    fit = lsq_linear(*_projected(s, base), bounds=signature.bounds[:, :count])
    explained = s @ fit.x
    gain = float(base @ base - np.sum((base - explained) ** 2))
    if gain <= 0 or not np.any(explained):
        return None
    return Score(signature.probe.with_values(**_magnitudes(signature, fit.x)), gain)


def _magnitudes(signature: Signature, coefficients: np.ndarray) -> dict[str, float]:
    placed = signature.placed([*coefficients, *[0.0] * len(signature.moments)])
    return {name: placed.params[name].value for name in signature.names}


def _projected(s: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reduce a least-squares problem to as many rows as columns: R and Q'b of s = QR, `ROWS` rows at a time."""
    k = s.shape[1]
    upper = np.zeros((0, k + 1))
    for start in range(0, len(s), ROWS):
        rows = slice(start, start + ROWS)
        upper = np.asarray(np.linalg.qr(np.vstack([upper, np.column_stack([s[rows], base[rows]])]), mode="r"))
    return upper[:k, :k], upper[:k, k]
