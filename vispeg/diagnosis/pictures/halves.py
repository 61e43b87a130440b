"""Compare fits to two halves of the views: a difference beyond its uncertainty means that the model is wrong.

mrcal's cross-validation (Kogan, mrcal documentation, "a tour of mrcal: cross-validation"): the difference of two fits'
projections, against what each fit says of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from vispeg.core.rules import RULES
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.identify.fit import Fit
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.worlds.world import World

Borders = tuple[BorderEvidence, BorderEvidence]  # fitted and held-out evidence


@dataclass(frozen=True)
class Halves:
    """Difference of the two halves' projections over the held-out views, and its uncertainty, RMS in px.

    The uncertainty is taken over the `views` of the smaller half: a spread over few of them says little of itself
    (cluster-robust standard errors; Cameron and Miller, Journal of Human Resources 50(2), 2015).
    """

    difference: float
    uncertainty: float
    views: int = 1000  # so many that the uncertainty counts as exact

    @property
    def disagree(self) -> bool:
        """Whether no world of this form fits both halves."""
        times = float(stats.t.ppf(stats.norm.cdf(RULES.halves_sigma), max(1, self.views - 1)))
        return self.difference > max(times * self.uncertainty, RULES.shift_px)


def compare_halves(search: PictureSearch, borders: Borders, world: World, n_fixed: int) -> Halves | None:
    """Fit the world's effects to every other view and to the rest; None if no effect was fitted."""
    if len(world.effects) <= n_fixed:
        return None
    evidence, judged = borders
    parts = [evidence.part(k, 2) for k in (0, 1)]
    fits = [search.fits([world], n_fixed, part)[0] for part in parts]
    spread = sum(uncertainty(judged, f) ** 2 for f in fits)
    views = min(len(np.unique(part.blocks())) for part in parts)
    return Halves(judged.change(fits[0].world, fits[1].world), float(np.sqrt(spread)), views)


def uncertainty(judged: BorderEvidence, fit: Fit) -> float:
    """Return the RMS standard error in px of a fit's projections over views."""
    covariance = fit.correlation * np.outer(fit.sigma, fit.sigma)
    here, columns = judged.misplaced(fit.space.at(fit.u)), []
    for step, axis in zip(fit.space.steps(fit.u), np.eye(len(fit.u)), strict=True):
        there = judged.misplaced(fit.space.at(fit.u + step * axis))
        columns.append(np.concatenate([(a - b) / step for a, b in zip(there, here, strict=True)]))
    jac = np.stack(columns, 1)
    jac = jac[np.isfinite(jac).all(1)]
    return float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", jac, covariance, jac)))) if len(jac) else 0.0
