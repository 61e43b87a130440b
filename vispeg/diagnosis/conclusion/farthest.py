"""Error of a model in the kind of channel (angles, torques, loads) that it describes worst.

A verdict uses it, because a mean over all readings would hide wrong angles if half of the readings were loads, whose
noise is large.
"""

from __future__ import annotations

import numpy as np

from vispeg.identify.evidence import Evidence


def farthest(judged: Evidence, residual: np.ndarray, floor: float = 1.0) -> float:
    """Return the largest mean squared whitened residual (error over noise) of a kind of channel, over its floor.

    Args:
        judged: held-out evidence.
        residual: whitened residual on it, flat.
        floor: mean squared whitened residual that the right model leaves over all readings. The part above 1 is due to
            coarse or noisy encoders, so it counts in the first kind of channel (angles) only.
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
