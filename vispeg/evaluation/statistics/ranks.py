"""How well success in one world predicts success in another, over many policies.

MMRV, the mean maximum rank violation, is SIMPLER's (X. Li et al., Evaluating Real-World Robot Manipulation Policies
in Simulation, CoRL 2024): mean over i of the largest |r_i - r_j| among the j that the two worlds order differently. 0
is best. Pearson's correlation does not see a bias, so the mean difference stands beside it. Policies that fail belong
into the comparison: among equals there is nothing to predict.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from vispeg.core.errors import UserError
from vispeg.evaluation.statistics.intervals import LEVEL, Estimate

FEWEST = 8  # policies below which a correlation is not called one
FEWEST_POINTS, TWO_POINTS = 3, "two points determine a line, so they correlate whatever they are"


@dataclass(frozen=True)
class Prediction:
    """How success x in a reference world predicts success y in a target.

    Attributes:
        pearson, spearman: correlations, NaN where either side does not vary and of two policies, whose line says
            nothing; intervals by bootstrap over policies.
        mmrv: mean maximum rank violation, in success (0 to 1).
        mean_difference: mean of x - y.
        n: policies.
    """

    pearson: Estimate
    spearman: Estimate
    mmrv: Estimate
    mean_difference: Estimate
    n: int

    @property
    def enough(self) -> bool:
        """Whether there are policies enough, and variation, for a correlation to mean anything."""
        return self.n >= FEWEST and math.isfinite(self.pearson.value)


def mmrv(target: np.ndarray, reference: np.ndarray) -> float:
    """Mean maximum rank violation of (n,) success rates: `target` is what counts, `reference` what shall predict it."""
    r, s = np.asarray(target, float), np.asarray(reference, float)
    violated = (s[:, None] < s) != (r[:, None] < r)
    return float(np.mean(np.max(np.abs(r[:, None] - r) * violated, axis=1)))


def predict(reference: np.ndarray, target: np.ndarray, rng: np.random.Generator, draws: int = 1000) -> Prediction:
    """All four measures over (n,) policies.

    Raises:
        UserError: fewer than two policies, or sequences of different length.
    """
    x, y = np.asarray(reference, float), np.asarray(target, float)
    if x.shape != y.shape or x.ndim != 1 or len(x) < 2:
        raise UserError(
            "not a comparison over policies", expected="two or more, in both worlds", got=(x.shape, y.shape)
        )
    rows = rng.integers(len(x), size=(draws, len(x)))
    xs, ys = np.vstack([x, x[rows]]), np.vstack([y, y[rows]])  # (1 + draws, n), the data first
    violations = np.array([mmrv(b, a) for a, b in zip(xs, ys, strict=True)])
    ranks = [rankdata(z, axis=1) for z in (xs, ys)]
    measures = (_pearson(xs, ys), _pearson(ranks[0], ranks[1]), violations, np.mean(xs - ys, axis=1))
    estimates = []
    for values in measures:
        finite = values[1:][np.isfinite(values[1:])]
        low, high = np.quantile(finite, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2]) if len(finite) else (math.nan, math.nan)
        estimates.append(Estimate(float(values[0]), float(low), float(high), len(x)))
    if len(x) < FEWEST_POINTS:
        estimates[:2] = [Estimate(math.nan, math.nan, math.nan, len(x))] * 2
    return Prediction(*estimates, n=len(x))


def _pearson(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Correlation (m,) along the rows of two (m, n) arrays, NaN where one does not vary."""
    x, y = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
    scale = np.sqrt(np.sum(x * x, axis=1) * np.sum(y * y, axis=1))
    return np.divide(np.sum(x * y, axis=1), scale, out=np.full(len(x), np.nan), where=scale > 1e-12)
