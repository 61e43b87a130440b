"""Whether a fitted effect is the same at all times and positions: one that is not stands in for something else.

Effects are constant: friction that falls while a gear warms up, or that is there at one angle alone, is none of them,
and a constant one fits part of it. So the magnitudes of each joint's effect are let differ between quarters of the
recordings, and between quarters of the joint's range, in the linear model of the fit, all other parameters free. Where
that removes a visible share of what the joint leaves unexplained, and the values are far apart, the effect is no name.

Source: Chow, Econometrica 28(3), 1960 (coefficients of parts against those of the whole).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import effect
from vispeg.diagnosis.evidence.dictionary import null_of
from vispeg.identify.channels import Item
from vispeg.identify.fit import Fit

PARTS = 4
REMOVES = 0.3  # of the error left in the joint, that values of their own for the parts must remove
APART = 0.5  # of an effect's value, by which those of the parts must differ at least
RIDGE = 1e-9  # of each column's own norm: directions that the evidence cannot determine stay


@dataclass(frozen=True)
class Change:
    """An effect that is not constant.

    Attributes:
        label: of the effect.
        over: `time` or `position`.
        parts: (PARTS,) its first magnitude in each part, over the fitted one.
        share: of the squared error left in its joint, that such values remove.
    """

    label: str
    over: str
    parts: tuple[float, ...]
    share: float

    def said(self) -> str:
        """What a reader is told."""
        what = "as the recordings go on" if self.over == "time" else "over the joint's range"
        values = ", ".join(f"{p:.2g}" for p in self.parts)
        return f"{self.label} is not constant {what} ({values} of its value): it stands in for something that changes"


def changes(items: Sequence[Item], fit: Fit, n_fixed: int, excess: Mapping[str, float]) -> list[Change]:
    """Joints' effects after the first `n_fixed` of a fit that are not constant.

    `excess` is the squared residual over the noise that is left in each joint.
    """
    joints, null, out = items[0].robot.joints, null_of(fit), []
    by_time = _moments(fit, items, _times(items))
    for j, joint in enumerate(joints):
        placed = {k: _magnitudes(fit, k) for k, e in enumerate(fit.world.effects) if k >= n_fixed and e.where == joint}
        placed = {k: axes for k, axes in placed.items() if axes and fit.u[axes[0]] != null[axes[0]]}
        if not placed:
            continue
        angles = np.concatenate([item.posture[:, j] for item in items])
        by_position = _moments(fit, items, _quarters(angles))
        for k, axes in placed.items():
            for over, moments in (("time", by_time), ("position", by_position)):
                drop, moved = _apart(*moments, axes)
                parts = 1.0 + moved / (fit.u - null)[axes[0]]
                if drop >= REMOVES * excess[joint] and np.ptp(parts) >= APART:
                    label = fit.world.effects[k].label
                    out.append(Change(label, over, tuple(parts.tolist()), drop / excess[joint]))
                    break
    return out


def _magnitudes(fit: Fit, index: int) -> list[int]:
    """Axes of an effect's magnitudes, of those that vanish on a straight line."""
    names = effect(fit.world.effects[index].effect).magnitudes
    mine = [(i, a) for i, a in enumerate(fit.space.axes) if a.index == index and a.name in names]
    return [i for i, a in mine if a.param.scale == "linear" and not a.param.shape]


def _times(items: Sequence[Item]) -> np.ndarray:
    """Part of its recording in which each sample lies, items end to end."""
    out = []
    for item in items:
        start = item.recording.time[item.segment.rows[0]]
        windows = [i for i in items if i.recording is item.recording]
        begin, end = (f(i.recording.time[i.segment.rows[k]] for i in windows) for f, k in ((min, 0), (max, -1)))
        age = (start + item.segment.time - begin) / max(end - begin, 1e-9)
        out.append(np.clip((PARTS * age).astype(int), 0, PARTS - 1))
    return np.concatenate(out)


def _quarters(values: np.ndarray) -> np.ndarray:
    """Part of the distribution of `values` in which each lies."""
    return np.digitize(values, np.quantile(values, np.arange(1, PARTS) / PARTS))


def _moments(fit: Fit, items: Sequence[Item], part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inner products (PARTS, p, p) of the derivatives, and (PARTS, p) with the residual, over each part."""
    of = np.repeat(part, np.repeat([i.measured.shape[1] for i in items], [len(i.measured) for i in items]))
    rows = [of == s for s in range(PARTS)]
    return (
        np.stack([fit.jacobian[r].T @ fit.jacobian[r] for r in rows]),
        np.stack([fit.jacobian[r].T @ fit.residual[r] for r in rows]),
    )


def _apart(gram: np.ndarray, slope: np.ndarray, free: list[int]) -> tuple[float, np.ndarray]:
    """Drop of the squared residual where the coordinates `free` differ between parts, and how the first moves in each.

    Beside a fit in which they are one, all other coordinates are fitted in both.
    """
    rest = [i for i in range(gram.shape[1]) if i not in free]
    once = _solved(gram.sum(axis=0), slope.sum(axis=0))[0]
    r, k = len(rest), len(free)
    size = r + PARTS * k
    matrix, right = np.zeros((size, size)), np.zeros(size)
    matrix[:r, :r], right[:r] = gram.sum(axis=0)[np.ix_(rest, rest)], slope.sum(axis=0)[rest]
    for s in range(PARTS):
        at = slice(r + s * k, r + (s + 1) * k)
        matrix[at, at], right[at] = gram[s][np.ix_(free, free)], slope[s][free]
        matrix[at, :r] = gram[s][np.ix_(free, rest)]
        matrix[:r, at] = matrix[at, :r].T
    drop, x = _solved(matrix, right)
    return drop - once, x[r::k]


def _solved(matrix: np.ndarray, slope: np.ndarray) -> tuple[float, np.ndarray]:
    """Drop of |r + J x|^2 from x = 0 to its least, and that x, of J'J and J'r."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-18))
    inner = matrix / np.outer(scale, scale) + RIDGE * np.eye(len(scale))
    x = -np.linalg.solve(inner, slope / scale)
    return float(x @ inner @ x), x / scale
