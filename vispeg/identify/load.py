"""Compare a servo's reported load, which is proportional to its motor's torque with an unknown gain.

For each world and joint the best-fitting gain over all recordings is used, so only the shape of the load over time says
anything of the world.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.rules import RULES
from vispeg.identify.channels import Item
from vispeg.recordings.noise import highpass_sigma
from vispeg.recordings.recording import Recording


def unsigned(rec: Recording) -> bool:
    """Return whether a recording's load has no sign: no joint's reading is ever negative."""
    return rec.load is not None and bool(np.nanmin(rec.load) >= 0)


def load_noise(load: np.ndarray) -> np.ndarray:
    """Return the noise (nj,) of a load (n, nj), in its unit: that of its high frequencies.

    It is at least a share of the joint's spread, and of the RMS spread over joints with readings, so a joint at rest or
    without readings has some too.
    """
    read = np.isfinite(load).any(axis=0)
    spread = np.nanstd(np.where(read, load, 0.0), axis=0)
    least = max(RULES.load_noise * float(np.sqrt(np.sum(spread**2) / max(read.sum(), 1))), 1e-9)
    return np.maximum(np.maximum(highpass_sigma(load), RULES.load_noise * spread), least)


def with_gains(items: Sequence[Item], predicted: list[np.ndarray]) -> list[np.ndarray]:
    """Multiply the load columns of predictions (nworld, m, nch), in place, by the best gain of each world and joint.

    The gain is the weighted least-squares one, sum(m y / sigma^2) / sum(y^2 / sigma^2), over the valid readings m of
    all items, with predictions y.
    """
    numerator, denominator = 0.0, 0.0
    for item, y in zip(items, predicted, strict=True):
        for columns, c in _loads(item):
            weight = c.valid / c.sigma**2
            measured, torque = np.where(c.valid, c.measured, 0.0), y[:, :, columns]
            numerator = numerator + np.einsum("mj,mj,wmj->wj", weight, measured, torque)
            denominator = denominator + np.einsum("mj,wmj,wmj->wj", weight, torque, torque)
    if np.ndim(numerator) == 0:  # no item has a load
        return predicted
    gain = numerator / np.maximum(denominator, 1e-300)
    for item, y in zip(items, predicted, strict=True):
        for columns, _ in _loads(item):
            y[:, :, columns] *= gain[:, None]
    return predicted


def _loads(item: Item):
    """Yield (columns, channel) of the load channels of an item."""
    start = 0
    for c in item.channels:
        stop = start + c.measured.shape[1]
        if c.kind == "load":
            yield slice(start, stop), c
        start = stop
