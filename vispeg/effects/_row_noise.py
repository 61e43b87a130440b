"""Random numbers without a generator: a hash of (seed, tick, lane), so that a row draws the same in any batch.

Counter-based, as in Salmon et al. 2011, Parallel random numbers: as easy as 1, 2, 3; the mixing function is that of
SplitMix64 (Steele, Lea and Flood 2014, Fast splittable pseudorandom number generators).
"""

from __future__ import annotations

import zlib

import numpy as np
from scipy.special import ndtri


def uniform(name: str, seed: np.ndarray, tick: np.ndarray, lane: np.ndarray | int) -> np.ndarray:
    """Numbers in (0, 1), shape of `seed`, independent over seeds, ticks, lanes and names.

    Args:
        name: of the effect.
        seed: (nsim, n) whole numbers >= 0.
        tick: (nsim,) since the episode began.
        lane: (n,) which of the numbers of a tick.
    """
    x = np.broadcast_to(np.uint64(zlib.crc32(name.encode())), seed.shape)
    for key in (seed, np.broadcast_to(tick[:, None], seed.shape), np.broadcast_to(lane, seed.shape)):
        x = _mixed(x + key.astype(np.uint64))
    return ((x >> np.uint64(11)).astype(float) + 0.5) * 2.0**-53


def normal(name: str, seed: np.ndarray, tick: np.ndarray, lane: np.ndarray | int) -> np.ndarray:
    """Standard normal numbers, as `uniform`."""
    return ndtri(uniform(name, seed, tick, lane))


def _mixed(x: np.ndarray) -> np.ndarray:
    x = x + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))
