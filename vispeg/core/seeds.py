"""Random number generators keyed by name, so that an additional draw does not change any other."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError

LAST_SEED = 2**63 - 1  # results and environments store seeds as 64-bit integers


def stream(seed: int, *keys: object) -> np.random.Generator:
    """Return the generator for (seed, keys). It is the same on every machine and independent of those of other keys.

    Raises:
        UserError: as `check_seed`.
    """
    check_seed(seed)
    words = _words("\x1f".join(map(str, keys)))
    if 0 <= seed < 2**32:  # the same entropy as below, computed faster
        entropy = np.empty(9, np.uint32)
        entropy[0], entropy[1:] = seed, words
        return np.random.Generator(np.random.PCG64(entropy))
    return np.random.default_rng([seed, *words.tolist()])


def check_seed(seed: object, key: str | None = "--seed", file: str | Path | None = None) -> None:
    """Raise UserError unless a seed is a whole number from 0 to LAST_SEED; `key` and `file` say where it was stated."""
    if not isinstance(seed, int | np.integer) or not 0 <= seed <= LAST_SEED:
        raise UserError("no such seed", key=key, file=file, expected="a whole number from 0 to 2^63 - 1", got=seed)


@lru_cache(maxsize=4096)
def _words(key: str) -> np.ndarray:
    return np.frombuffer(hashlib.sha256(key.encode()).digest(), np.uint32)
