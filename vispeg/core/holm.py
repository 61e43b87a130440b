"""Holm's procedure: adjust the p-values of several tests for the chance of any false positive among them.

S. Holm, A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6, 1979.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def holm(p: Sequence[float], weights: Sequence[float] | None = None) -> list[float]:
    """Return p-values adjusted by Holm's method, in the order of `p`.

    The j-th smallest p / weight is multiplied by the sum of the weights from the j-th on (without weights, by
    m - j + 1). Adjusted values increase with p / weight and are at most 1.
    """
    each = np.ones(len(p)) if weights is None else np.asarray(weights, float)
    scaled = np.asarray(p, float) / each
    adjusted, largest, remaining = [0.0] * len(p), 0.0, float(each.sum())
    for index in np.argsort(scaled, kind="stable"):
        largest = max(largest, min(1.0, remaining * float(scaled[index])))
        adjusted[int(index)] = largest
        remaining -= float(each[index])
    return adjusted
