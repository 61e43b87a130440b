"""Random streams keyed by name, so that adding one draw leaves every other as it was."""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np

from vispeg.core.errors import UserError


def stream(seed: int, *keys: object) -> np.random.Generator:
    """Give a generator of its own for (seed, keys): the same on every machine, independent of all others.

    Raises:
        UserError: the seed is negative.
    """
    check_seed(seed)
    words = _words("\x1f".join(map(str, keys)))
    if 0 <= seed < 2**32:  # the same entropy, without a detour through Python's integers
        entropy = np.empty(9, np.uint32)
        entropy[0], entropy[1:] = seed, words
        return np.random.Generator(np.random.PCG64(entropy))
    return np.random.default_rng([seed, *words.tolist()])


def check_seed(seed: int) -> None:
    """Refuse what is no seed, before anything is done that needs one. Raises UserError."""
    if seed < 0:
        raise UserError("not a seed", key="--seed", expected="0 or more", got=seed)


@lru_cache(maxsize=4096)
def _words(key: str) -> np.ndarray:
    return np.frombuffer(hashlib.sha256(key.encode()).digest(), np.uint32)
