"""Random number generators keyed by name, so that an additional draw does not change any other."""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np

from vispeg.core.errors import UserError


def stream(seed: int, *keys: object) -> np.random.Generator:
    """Return the generator for (seed, keys). It is the same on every machine and independent of those of other keys.

    Raises:
        UserError: the seed is negative.
    """
    check_seed(seed)
    words = _words("\x1f".join(map(str, keys)))
    if 0 <= seed < 2**32:  # the same entropy as below, computed faster
        entropy = np.empty(9, np.uint32)
        entropy[0], entropy[1:] = seed, words
        return np.random.Generator(np.random.PCG64(entropy))
    return np.random.default_rng([seed, *words.tolist()])


def check_seed(seed: int) -> None:
    """Raise UserError if the seed is negative."""
    if seed < 0:
        raise UserError("not a seed", key="--seed", expected="0 or more", got=seed)


@lru_cache(maxsize=4096)
def _words(key: str) -> np.ndarray:
    return np.frombuffer(hashlib.sha256(key.encode()).digest(), np.uint32)
