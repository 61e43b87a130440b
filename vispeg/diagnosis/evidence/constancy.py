"""Test whether a fitted effect is constant over time and position; if not, it imitates another one.

Library effects are constant. Friction that falls as a gear warms up, or that exists at one angle only, is not in the
library, and a constant one fits a part of it. So in the linear model of the fit the magnitudes of each joint's effect
may take other values in each quarter of a recording, or in each quartile of the joint's angles, with all other
parameters free. The effect is not named if that removes at least the share `RULES.parts_remove` of the squared error
above noise in the joint's own channels, and the values of the parts differ by at least the share `RULES.parts_apart` of
the constant fit's. Improvement in other joints does not count, because under torque control an error in one joint moves
all. Source: Chow, Econometrica 28(3), 1960 (coefficients of parts against those of the whole).

A magnitude is a parameter whose null, a value such as 0, removes the effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.dictionary import null_of
from vispeg.identify.channels import Item
from vispeg.identify.fit import Fit

RIDGE = 1e-9  # times each column's squared norm, added to it: keeps undetermined directions fixed


@dataclass(frozen=True)
class Change:
    """An effect that is not constant.

    Attributes:
        label: of the effect.
        over: `time` or `position`.
        parts: (nparts,) distance of its first magnitude from null in each part, over that of the constant fit.
        share: squared error that values of the parts remove in its joint's channels, over that above noise there; over
            1 if they fit noise too.
    """

    label: str
    over: str
    parts: tuple[float, ...]
    share: float

    def said(self) -> str:
        """Return the message for the reader."""
        what = "as the recordings go on" if self.over == "time" else "over the joint's range"
        values = ", ".join(f"{p:.2g}" for p in self.parts)
        return f"{self.label} is not constant {what} ({values} of its value): it stands in for something that changes"


def changes(items: Sequence[Item], fit: Fit, n_fixed: int, excess: Mapping[str, float]) -> list[Change]:
    """Return the effects of single joints, after the first `n_fixed` of a fit, that are not constant.

    `excess` is for each joint the squared whitened residual above noise.
    """
    joints, null, out = items[0].robot.joints, null_of(fit), []
    times, channel = _entries(items, _times(items)), _channels(items)
    over_time = _moments(fit, times)
    for j, joint in enumerate(joints):
        here = [k for k, e in enumerate(fit.world.effects) if k >= n_fixed and e.where == joint]
        by_effect = {k: _magnitudes(fit, k) for k in here}
        by_effect = {k: axes for k, axes in by_effect.items() if axes and fit.u[axes[0]] != null[axes[0]]}
        if not by_effect:
            continue
        quarters = _entries(items, _quarters(np.concatenate([item.posture[:, j] for item in items])))
        ways = [
            ("time", over_time, _moments(fit, times, channel == j)),
            ("position", _moments(fit, quarters), _moments(fit, quarters, channel == j)),
        ]
        for k, axes in by_effect.items():
            for over, everywhere, own in ways:
                drop, moved = _apart(everywhere, own, axes)
                parts = 1.0 + moved / (fit.u - null)[axes[0]]
                if drop >= RULES.parts_remove * excess[joint] and np.ptp(parts) >= RULES.parts_apart:
                    label = fit.world.effects[k].label
                    out.append(Change(label, over, tuple(parts.tolist()), drop / excess[joint]))
                    break  # one way of changing is enough, and time is said first
    return out


def _magnitudes(fit: Fit, index: int) -> list[int]:
    """Return the indices of the fit's axes that are an effect's linear magnitudes.

    None are returned if the effect is recognised by a parameter on a log scale, such as a servo's.
    """
    kind = effect(fit.world.effects[index].effect)
    if any(kind.params[name].scale != "linear" for name in kind.telling):  # a servo, whose gain may be null
        return []
    names = kind.magnitudes
    mine = [(i, a) for i, a in enumerate(fit.space.axes) if a.index == index and a.name in names]
    return [i for i, a in mine if a.param.scale == "linear" and not a.param.shape]


def _times(items: Sequence[Item]) -> np.ndarray:
    """Return for each sample the quarter (0 to 3) of its recording's samples, items end to end."""
    recording = np.repeat([id(i.recording) for i in items], [len(i.measured) for i in items])
    out = np.zeros(len(recording), int)
    for same in np.unique(recording):
        rows = np.flatnonzero(recording == same)
        out[rows] = RULES.folds * np.arange(len(rows)) // len(rows)
    return out


def _quarters(values: np.ndarray) -> np.ndarray:
    """Return the quartile (0 to 3) of each of `values`; 3 for NaN."""
    return np.digitize(values, np.nanquantile(values, np.arange(1, RULES.folds) / RULES.folds))


def _entries(items: Sequence[Item], values: np.ndarray) -> np.ndarray:
    """Repeat one value per sample for each column of that sample in the flat residual."""
    widths = [i.measured.shape[1] for i in items]
    return np.repeat(values, np.repeat(widths, [len(i.measured) for i in items]))


def _channels(items: Sequence[Item]) -> np.ndarray:
    """Return the joint of each entry of the residual."""
    nj = len(items[0].robot.joints)
    return np.concatenate([np.tile(np.arange(i.measured.shape[1]) % nj, len(i.measured)) for i in items])


def _moments(fit: Fit, part: np.ndarray, where: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return inner products over each part, J'J (nparts, p, p) and J'r (nparts, p), for a fit with p axes.

    `part` (n,) is the part of each entry of the residual; `where` (n,) selects entries, None all.
    """
    rows = [part == s if where is None else where & (part == s) for s in range(RULES.folds)]
    return (
        np.stack([fit.jacobian[r].T @ fit.jacobian[r] for r in rows]),
        np.stack([fit.jacobian[r].T @ fit.residual[r] for r in rows]),
    )


def _apart(
    everywhere: tuple[np.ndarray, np.ndarray], here: tuple[np.ndarray, np.ndarray], free: list[int]
) -> tuple[float, np.ndarray]:
    """Return what separate values in each part gain for the axes `free`.

    Args:
        everywhere: `_moments` of the whole residual, which both fits minimise: one with separate values of these axes
            in each part, one with common values.
        here: `_moments` of the joint's own channels.
        free: axes that may differ between parts; all others have common values.

    Returns:
        drop of the squared residual `here` from the common to the separate values, and the change (nparts,) of the
        first free axis from the fitted value in each part.
    """
    gram, slope = everywhere
    p, k = gram.shape[1], len(free)
    common = [i for i in range(p) if i not in free]
    r = len(common)
    matrix, right = np.zeros((r + RULES.folds * k, r + RULES.folds * k)), np.zeros(r + RULES.folds * k)
    matrix[:r, :r], right[:r] = gram.sum(axis=0)[np.ix_(common, common)], slope.sum(axis=0)[common]
    for s in range(RULES.folds):
        at = slice(r + s * k, r + (s + 1) * k)
        matrix[at, at], right[at] = gram[s][np.ix_(free, free)], slope[s][free]
        matrix[at, :r] = gram[s][np.ix_(free, common)]
        matrix[:r, at] = matrix[at, :r].T
    once, x = _solved(gram.sum(axis=0), slope.sum(axis=0)), _solved(matrix, right)
    apart = np.zeros((RULES.folds, p))
    apart[:, common], apart[:, free] = x[:r], x[r:].reshape(RULES.folds, k)
    return _squares(here, np.tile(once, (RULES.folds, 1))) - _squares(here, apart), x[r::k]


def _squares(moments: tuple[np.ndarray, np.ndarray], x: np.ndarray) -> float:
    """Return the rise of |r|^2 if the coordinates change by row s of x (nparts, p) in part s."""
    gram, slope = moments
    return float(np.einsum("si,sij,sj->", x, gram, x) + 2.0 * np.sum(slope * x))


def _solved(matrix: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return the minimiser x of |r + J x|^2, given J'J and J'r."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-18))
    inner = matrix / np.outer(scale, scale) + RIDGE * np.eye(len(scale))
    return -np.linalg.solve(inner, slope / scale) / scale
