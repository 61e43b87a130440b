"""How far a model is from the recordings in the kind of channel that it describes worst."""

from __future__ import annotations

import numpy as np

from vispeg.identify.evidence import Evidence


def farthest(judged: Evidence, residual: np.ndarray, floor: float = 1.0) -> float:
    """Mean squared whitened residual of one kind of channel over its floor, the greatest of all kinds.

    A mean over all readings would call a model near whose angles are far, if it is told half of loads that say little:
    their noise is wide.

    Args:
        judged: held-out evidence.
        residual: whitened, on it.
        floor: what the right model leaves as a mean over all readings, in noise variances; what is above 1 is of
            coarse or noisy encoders, hence of the principal channel.
    """
    total: dict[str, float] = {}
    count: dict[str, int] = {}
    start = 0
    for item in judged.items:
        squared = residual[start : start + item.measured.size].reshape(item.measured.shape) ** 2
        start += item.measured.size
        edges = np.cumsum([0, *(c.measured.shape[1] for c in item.channels)])
        for c, first, last in zip(item.channels, edges, edges[1:], strict=False):
            total[c.kind] = total.get(c.kind, 0.0) + float(np.sum(squared[:, first:last] * c.valid))
            count[c.kind] = count.get(c.kind, 0) + int(c.valid.sum())
    principal = judged.items[0].kind
    floors = dict.fromkeys(total, 1.0)
    floors[principal] += (floor - 1.0) * judged.count / max(count[principal], 1)
    return max(total[kind] / max(count[kind], 1) / floors[kind] for kind in total)
