"""Score test over the whole library: the part of the residual that each effect, at each place, can explain.

It needs no fit: the residual is projected on the effects' signatures, its first-order changes (`signatures`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.optimize import lsq_linear

from vispeg.core.effect import effect, searchable
from vispeg.diagnosis.evidence.signatures import Signature
from vispeg.diagnosis.findings import Score
from vispeg.identify.evidence import Evidence
from vispeg.worlds.world import World

ROWS = 2**16  # rows of a least-squares problem factorised at a time


def candidates(evidence: Evidence, world: World, joints: Sequence[str]) -> list[tuple[str, str]]:
    """Return every (effect, place) of the library that the world lacks and the evidence can show.

    Of the joints only `joints` are places, except for effects that make no torque at their own joint.
    """
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
    """Return groups of effects that every arm has in all joints and the world lacks, as (effect, place).

    There is one group per kind (`Effect.common`: friction, rotor inertia, bias), except those in `done`.
    """
    places_by_effect: dict[str, list[tuple[str, str]]] = {}
    for name, place in candidates(evidence, world, evidence.items[0].robot.joints):
        common = effect(name).common
        if common and common not in done and place != "all":
            places_by_effect.setdefault(common, []).append((name, place))
    return [places for places in places_by_effect.values() if len(places) > 1]


def screen(
    taken: Sequence[Signature],
    residual: np.ndarray,
    jacobian: np.ndarray | None,
    places: Sequence[tuple[str, str]],
    together: Sequence[Sequence[tuple[str, str]]] = (),
) -> list[Score]:
    """Return the scores of single effects and of groups of them, best first; those without gain are left out.

    Args:
        taken: signatures at all these places, one or several of each effect.
        residual: (n,) whitened residual of the world to which the signatures are relative, on the same evidence.
        jacobian: (n, p) its derivatives to the fitted parameters, whose changes count as explained already; None if
            nothing is fitted.
        places: (effect, place) to score alone.
        together: groups of (effect, place) to score as one.
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
    """Score a group of effects added together, by their magnitudes' columns; None if fewer than two do anything.

    `base` is the residual without its projection on the orthonormal `basis`.
    """
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
    """Return an orthonormal basis (n, p) of the jacobian's columns."""
    if jacobian is None or jacobian.shape[1] == 0:
        return np.zeros((n, 0))
    return np.linalg.qr(jacobian)[0]


def _score(signature: Signature, base: np.ndarray, basis: np.ndarray) -> Score | None:
    """Score one effect by its magnitudes' columns; None if it explains nothing of `base`."""
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
    """Return start values of the magnitudes from their columns' coefficients."""
    placed = signature.placed([*coefficients, *[0.0] * len(signature.moments)])
    return {name: placed.params[name].value for name in signature.names}


def _projected(s: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reduce the least-squares problem s x = base to as many rows as columns: R and Q'base of s = QR."""
    k = s.shape[1]
    upper = np.zeros((0, k + 1))
    for start in range(0, len(s), ROWS):
        rows = slice(start, start + ROWS)
        upper = np.asarray(np.linalg.qr(np.vstack([upper, np.column_stack([s[rows], base[rows]])]), mode="r"))
    return upper[:k, :k], upper[:k, k]
