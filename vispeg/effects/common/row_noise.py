"""Random numbers from a hash of (seed, tick, lane), so that a simulation draws the same numbers in any batch.

They are counter-based, as in Salmon et al. 2011, Parallel random numbers: as easy as 1, 2, 3; the mixing function is
that of SplitMix64 (Steele, Lea and Flood 2014, Fast splittable pseudorandom number generators).
"""

from __future__ import annotations

import zlib

import numpy as np


def keys(name: str, seed: np.ndarray, lane: np.ndarray | int) -> np.ndarray:
    """Return the keys (nsim, n) uint64 of random streams for `uniform` and `normal`.

    Args:
        name: the effect's name, so that two effects with one seed differ.
        seed: (nsim, n) whole numbers >= 0.
        lane: (n,) whole numbers that tell the streams of one seed apart; equal lanes give equal streams.
    """
    x = _mixed(np.uint64(zlib.crc32(name.encode())) + seed.astype(np.uint64))
    return _mixed(x + np.broadcast_to(lane, seed.shape).astype(np.uint64))


def uniform(key: np.ndarray, tick: np.ndarray) -> np.ndarray:
    """Draw numbers in (0, 1), (nsim, n), of streams `key` (nsim, n) at ticks (nsim,) since the episode began."""
    return ((_mixed(key + tick.astype(np.uint64)[:, None]) >> np.uint64(11)).astype(float) + 0.5) * 2.0**-53


def normal(key: np.ndarray, tick: np.ndarray) -> np.ndarray:
    """Draw standard normal numbers, as `uniform`."""
    from scipy.special import ndtri  # a quarter of a second that a command's help does not need

    return ndtri(uniform(key, tick))


def _mixed(x: np.ndarray) -> np.ndarray:
    """Return SplitMix64's hash of uint64 numbers."""
    x = x + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))
