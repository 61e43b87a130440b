"""Linear model of a fit and all candidates: predicts the residual of any set of effects without a rollout.

It needs only one Gram matrix of the derivatives to the fitted parameters, the candidates' signatures (first-order
changes of the residual, `signatures`) and the residual. It is exact for torques and effects that are linear; otherwise
it proposes, and rollouts decide.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.evidence.signatures import Signature
from vispeg.identify.fit import Fit

ROWS = 20_000  # rows of the residual multiplied at a time
RIDGE = 1e-9  # times each column's squared norm, added to it: keeps undetermined directions fixed
NOTHING = 1e-3  # a unit column whose part independent of the chosen ones is shorter adds nothing


class Entry:
    """One effect at one place, with its columns of the matrix and their bounds.

    Args:
        placed: the effect; of a candidate, with the values of its signature.
        columns: (k,) indices of its columns in the matrix.
        bounds: (2, k) of the coefficients.
        signature: of a candidate; None for an effect of the fit, whose coefficients are distances from null.
        index: of an effect of the fit, its index in the fit's world; None for a candidate.

    Attributes:
        key: (effect, where).
        size: number of its parameters.
        straight: whether the effect is proportional to its magnitudes (`Effect.straight`).
    """

    def __init__(
        self,
        placed: EffectInstance,
        columns: np.ndarray,
        bounds: np.ndarray,
        signature: Signature | None = None,
        index: int | None = None,
    ):
        self.placed, self.columns, self.bounds = placed, columns, bounds
        self.signature, self.index = signature, index
        self.key, self.size = (placed.effect, placed.where), len(placed.params)
        self.straight = effect(placed.effect).straight


class Dictionary:
    """Entries of a fit's effects and of the candidates, and the losses of sets of them.

    Sets (`chosen`) are lists of indices into `entries`. A set without one of the fit's effects models its removal.

    Args:
        residual: (n,) whitened, of the world to which the signatures are relative.
        signatures: of the candidates.
        fit: of that world; None if nothing is fitted.
        folds: rows of the residual left out in turn for cross-validation (`crossed`); without two or more, nothing is
            cross-validated.

    Attributes:
        entries: effects of the fit, then candidates.
        fitted: indices of the entries that are effects of the fit.
        scale: norms of the columns; `gram` and `slope` are the inner products of the columns divided by it.
        total: squared residual without any of the entries.
        parts: for each fold its Gram matrix of scaled columns, the residual last.
    """

    def __init__(
        self,
        residual: np.ndarray,
        signatures: Sequence[Signature],
        fit: Fit | None,
        folds: Sequence[slice] = (),
    ):
        self.entries: list[Entry] = []
        blocks, base, at = [], residual.astype(float), 0
        if fit is not None and fit.jacobian.shape[1]:
            away = fit.u - null_of(fit)
            low, high = fit.space.bounds
            base = base - fit.jacobian @ away
            blocks.append(-fit.jacobian)
            for index in sorted({a.index for a in fit.space.axes}):
                indices = np.array([i for i, a in enumerate(fit.space.axes) if a.index == index])
                bounds = np.array([low[indices], high[indices]]) - (fit.u - away)[indices]
                self.entries.append(Entry(fit.world.effects[index], indices, bounds, index=index))
            at = fit.jacobian.shape[1]
        for s in signatures:
            indices = np.arange(at, at + s.columns.shape[1])
            self.entries.append(Entry(s.probe, indices, s.bounds, s))
            blocks.append(s.columns)
            at += len(indices)
        self.fitted = [k for k, e in enumerate(self.entries) if e.signature is None]
        blocks.append(base[:, None])
        parts = [_gram(blocks, rows) for rows in folds] or [_gram(blocks, slice(0, len(base)))]
        gram = np.sum(parts, axis=0)
        self.scale = np.sqrt(np.maximum(np.diag(gram)[:-1], 1e-18))
        self.gram = gram[:-1, :-1] / np.outer(self.scale, self.scale)
        self.slope, self.total = gram[:-1, -1] / self.scale, float(gram[-1, -1])
        unit = np.append(self.scale, 1.0)
        self.parts = [part / np.outer(unit, unit) for part in parts] if len(folds) > 1 else []

    def loss(self, chosen: Sequence[int]) -> tuple[float, np.ndarray]:
        """Return the least squared residual of the entries `chosen`, and their coefficients within bounds for it."""
        if not len(chosen):
            return self.total, np.zeros(0)
        i = np.concatenate([self.entries[k].columns for k in chosen])
        bounds = np.concatenate([self.entries[k].bounds for k in chosen], axis=1) * self.scale[i]
        root = np.linalg.cholesky(self.gram[np.ix_(i, i)] + RIDGE * np.eye(len(i))).T
        along = solve_triangular(root, self.slope[i], trans=1)
        x = solve_triangular(root, along)
        if np.any(x < bounds[0]) or np.any(x > bounds[1]):
            x = lsq_linear(root, along, bounds=bounds + np.array([[-1e-9], [1e-9]])).x
        error = self.total - along @ along + np.sum((along - root @ x) ** 2)
        return float(error), x / self.scale[i]

    def at(self, chosen: Sequence[int], coefficients: np.ndarray) -> float:
        """Return the squared residual of the entries `chosen` with given coefficients, e.g. from other recordings."""
        if not len(chosen):
            return self.total
        i = np.concatenate([self.entries[k].columns for k in chosen])
        x = coefficients * self.scale[i]
        return float(self.total - 2.0 * x @ self.slope[i] + x @ self.gram[np.ix_(i, i)] @ x)

    def crossed(self, chosen: Sequence[int]) -> float:
        """Return the cross-validated squared residual: each fold is predicted with coefficients from the others.

        Coefficients at a bound stay there. Without folds it is the in-sample one.
        """
        in_sample, x = self.loss(chosen)
        if not self.parts or not len(chosen):
            return in_sample
        i = np.concatenate([self.entries[k].columns for k in chosen])
        bounds = np.concatenate([self.entries[k].bounds for k in chosen], axis=1)
        span = np.abs(x) + 1e-12
        held = (np.abs(x - bounds[0]) < 1e-6 * span) | (np.abs(x - bounds[1]) < 1e-6 * span)
        x, total = x * self.scale[i], 0.0
        for part in self.parts:
            gram, slope = part[np.ix_(i, i)], part[i, -1]
            other_gram, other_slope = self.gram[np.ix_(i, i)] - gram, self.slope[i] - slope
            refit, free = x.copy(), ~held
            if free.any():
                inner = other_gram[np.ix_(free, free)] + RIDGE * np.eye(int(free.sum()))
                refit[free] = np.linalg.solve(inner, other_slope[free] - other_gram[np.ix_(free, held)] @ x[held])
            total += part[-1, -1] - 2.0 * refit @ slope + refit @ gram @ refit
        return float(total)

    def gains(self, chosen: Sequence[int]) -> np.ndarray:
        """Return for each entry the predicted drop of the squared residual if it is added to `chosen`, ignoring bounds.

        It is 0 for chosen effects, and for entries that are combinations of the chosen ones.
        """
        gram, slope = self.gram, self.slope
        taken = {self.entries[k].key for k in chosen}
        if len(chosen):
            i = np.concatenate([self.entries[k].columns for k in chosen])
            both = np.column_stack([gram[i], slope[i]])
            answer = np.linalg.solve(gram[np.ix_(i, i)] + RIDGE * np.eye(len(i)), both)
            gram, slope = gram - gram[:, i] @ answer[:, :-1], slope - gram[:, i] @ answer[:, -1]
        out = np.zeros(len(self.entries))
        for k, entry in enumerate(self.entries):
            j = entry.columns
            if entry.key in taken or np.all(np.diag(gram)[j] < NOTHING**2):
                continue
            out[k] = slope[j] @ np.linalg.lstsq(gram[np.ix_(j, j)], slope[j], rcond=1e-6)[0]
        return out

    def placed(self, chosen: Sequence[int]) -> list[EffectInstance]:
        """Return the candidates among the chosen entries, with start values for a fit."""
        coefficients, out, at = self.loss(chosen)[1], [], 0
        for k in chosen:
            entry = self.entries[k]
            part = coefficients[at : at + len(entry.columns)]
            at += len(part)
            if entry.signature is not None:
                out.append(entry.signature.placed(part.tolist()))
        return out


def null_of(fit: Fit) -> np.ndarray:
    """Return the coordinates (naxis,) at which each effect of a fit is null: magnitudes at null, others as fitted."""
    out = fit.u.copy()
    for i, axis in enumerate(fit.space.axes):
        if not axis.param.shape and axis.name in effect(fit.world.effects[axis.index].effect).magnitudes:
            out[i] = fit.space.forward(axis.param.null, axis)
    return out


def _gram(blocks: Sequence[np.ndarray], rows: slice) -> np.ndarray:
    """Return the inner products (k, k) of all columns of the `blocks`, matrices side by side, over some rows."""
    width = sum(b.shape[1] for b in blocks)
    out = np.zeros((width, width))
    for start in range(rows.start, rows.stop, ROWS):
        stop = min(start + ROWS, rows.stop)
        part = np.concatenate([b[start:stop] for b in blocks], axis=1, dtype=float)
        out += part.T @ part
    return out
