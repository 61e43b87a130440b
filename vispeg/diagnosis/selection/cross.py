"""Cross-fitting: losses on the fitted recordings, each part predicted by a fit that did not use it.

A fold is one item of the evidence (a segment of a recording), or a part of the item if there is only one. Around the
common solution a fit is linear least squares, so leaving a fold out takes one Newton step and no rollout. That is exact
if the model is linear in its parameters, as torques are in friction, inertia and bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from vispeg.core.rules import RULES
from vispeg.diagnosis.selection.judge import Judge
from vispeg.identify.fit import Fit

RIDGE = 1e-9  # times each parameter's information, added to it: keeps directions without information fixed


class Cross:
    """Judge fits on the fitted evidence fold by fold, each fold as if it had been held out.

    Args:
        judge: on the fitted evidence.

    Attributes:
        folds: entries of the flat residual in each fold.
    """

    def __init__(self, judge: Judge):
        self.judge = judge
        items = judge.evidence.items
        parts = RULES.folds if len(items) == 1 else 1
        self.folds: list[slice] = []
        start = 0
        for item in items:
            rows, width = item.measured.shape
            edges = start + width * np.linspace(0, rows, parts + 1).astype(int)
            self.folds += [slice(a, b) for a, b in pairwise(edges)]
            start += item.measured.size

    def loss(self, residual: np.ndarray, jacobian: np.ndarray | None = None) -> np.ndarray:
        """Return the cross-validated loss (nblock, nj) of a fit.

        Args:
            residual: (n,) whitened residual of the fit.
            jacobian: (n, naxis) its derivatives; without any, nothing was fitted and it is the loss of the residual.
        """
        if jacobian is None or jacobian.shape[1] == 0:
            return self.judge.loss(residual)
        predicted = residual.copy()
        info = [jacobian[f].T @ jacobian[f] for f in self.folds]
        slope = [jacobian[f].T @ residual[f] for f in self.folds]
        all_info, all_slope = np.asarray(sum(info)), np.asarray(sum(slope))
        for k, fold in enumerate(self.folds):
            step = -np.linalg.solve(all_info - info[k] + _ridge(all_info), all_slope - slope[k])
            predicted[fold] = residual[fold] + jacobian[fold] @ step
        return self.judge.loss(predicted)

    def loss_of(self, fit: Fit | None, residual: np.ndarray) -> np.ndarray:
        """Return the `loss` of a fit with this residual, or, if it is None, of a world without fitted effects."""
        return self.loss(residual, None if fit is None else fit.jacobian)


def reduced(fit: Fit, gone: Sequence[int], null: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predict, to first order, a fit without some effects: their axes at null, the others at the new optimum.

    Args:
        fit: with the effects.
        gone: indices of their axes.
        null: (naxis,) coordinates at which effects do nothing.

    Returns:
        coordinates (naxis,) within their bounds; residual (n,), as if there were none; derivatives (n, nstay) of the
        axes that stay.
    """
    stay = [i for i in range(len(fit.u)) if i not in set(gone)]
    u = fit.u.copy()
    u[list(gone)] = null[list(gone)]
    residual = fit.residual + fit.jacobian[:, list(gone)] @ (u - fit.u)[list(gone)]
    columns = fit.jacobian[:, stay]
    if stay:
        info = columns.T @ columns
        step = -np.linalg.solve(info + _ridge(info), columns.T @ residual)
        u[stay] += step
        residual = residual + columns @ step
    low, high = fit.space.bounds
    return np.clip(u, low, high), residual, columns


def _ridge(info: np.ndarray) -> np.ndarray:
    """Return the matrix to add to an information matrix (naxis, naxis) so that it can be inverted."""
    return RIDGE * np.diag(np.diag(info) + 1e-12)


def on_held_out(judge: Judge, fit: Fit) -> Fit:
    """Return a fit with its residual and derivatives on the recordings of the judge; the last answer is cached."""
    if judge.last is not None and judge.last[0] is fit:
        return judge.last[1]
    steps = fit.space.steps(fit.u)
    moved = [fit.space.at(fit.u + step) for step in np.diag(steps)]
    residual, *after = judge.evidence.residuals([fit.world, *moved])
    columns = [(r - residual) / step for r, step in zip(after, steps, strict=True)]
    jacobian = np.stack(columns, axis=1) if columns else np.empty((len(residual), 0))
    judge.last = fit, replace(fit, residual=residual, columns=(jacobian,))
    return judge.last[1]
