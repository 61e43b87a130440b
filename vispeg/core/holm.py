"""Holm's procedure: p-values of a family, adjusted so that at most 5 % of families call anything that is not there.

S. Holm, A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6, 1979.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def holm(p: Sequence[float], weights: Sequence[float] | None = None) -> list[float]:
    """Adjust p-values: of the j-th smallest p / weight, multiply it by the weight of all from the j-th on (without
    weights, by m - j + 1); kept monotone and at most 1.
    """
    each = np.ones(len(p)) if weights is None else np.asarray(weights, float)
    scaled = np.asarray(p, float) / each
    order, adjusted, worst, left = np.argsort(scaled, kind="stable"), [0.0] * len(p), 0.0, float(each.sum())
    for index in order:
        worst = max(worst, min(1.0, left * float(scaled[index])))
        adjusted[int(index)] = worst
        left -= float(each[index])
    return adjusted
