"""How well success in one world predicts success in another, over many policies.

MMRV, the mean maximum rank violation, is SIMPLER's (X. Li et al., Evaluating Real-World Robot Manipulation Policies
in Simulation, CoRL 2024): mean over i of the largest |r_i - r_j| among the j that the two worlds order differently. 0
is best. Pearson's correlation does not see a bias, so the mean difference stands beside it. Policies that fail belong
into the comparison: among equals there is nothing to predict.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from scipy.stats import pearsonr, spearmanr

from vispeg.core.errors import UserError
from vispeg.evaluate.intervals import LEVEL, Estimate

FEWEST = 8  # policies below which a correlation is not called one


@dataclass(frozen=True)
class Prediction:
    """How success x in a reference world predicts success y in a target.

    Attributes:
        pearson, spearman: correlations, NaN where either side does not vary; intervals by bootstrap over policies.
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
    measures = (lambda a, b: _correlation(pearsonr, a, b), lambda a, b: _correlation(spearmanr, a, b))
    measures += (lambda a, b: mmrv(b, a), lambda a, b: float(np.mean(a - b)))
    found = []
    for measure in measures:
        values = np.array([measure(x[row], y[row]) for row in rows])
        finite = values[np.isfinite(values)]
        low, high = np.quantile(finite, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2]) if len(finite) else (math.nan, math.nan)
        found.append(Estimate(measure(x, y), float(low), float(high), len(x)))
    return Prediction(*found, n=len(x))


def _correlation(measure, x: np.ndarray, y: np.ndarray) -> float:  # type: ignore[no-untyped-def]
    if np.ptp(x) < 1e-12 or np.ptp(y) < 1e-12:
        return math.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return float(measure(x, y)[0])
