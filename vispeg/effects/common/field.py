"""Random fields over images: noise that is correlated over pixels, and over successive frames."""

from __future__ import annotations

import math
from collections.abc import MutableMapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np


def random_words(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Draw independent uint16 numbers of this shape, uniform over 0 to 65535.

    `rng` must return 64 bits a draw, as all bit generators of NumPy except MT19937 do.
    """
    size = math.prod(shape)
    return rng.bit_generator.random_raw((size + 3) // 4).view(np.uint16)[:size].reshape(shape)


def normal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Draw independent standard normal numbers of this shape, float32, from a table of 65536 quantiles.

    No number is beyond +-4.3. This takes a quarter of the time of NumPy's generator; a frame needs tens of thousands.
    """
    return _quantiles().take(random_words(rng, shape))


@lru_cache(maxsize=1)
def _quantiles() -> np.ndarray:
    from scipy.special import ndtri

    table = ndtri((np.arange(65536) + 0.5) / 65536)
    return (table / table.std()).astype(np.float32)


def correlated(rng: np.random.Generator, shape: tuple[int, int], length: float) -> np.ndarray:
    """Draw a Gaussian field (H, W) float32 of mean 0 and variance 1.

    Its correlation at r px is exp(-r^2 / (4 length^2)). It is white noise, filtered by a Gaussian of standard deviation
    `length` px that is scaled to keep the variance. The noise is wider than the image by the filter's radius, so that
    the variance is the same up to the image's border. Below 0.2 px the noise stays white.
    """
    if length < 0.2:  # the filter would be a single pixel
        return normal(rng, shape)
    import cv2

    kernel = _low_pass(length)
    r = len(kernel) // 2
    wide = normal(rng, (shape[0] + 2 * r, shape[1] + 2 * r))
    return cv2.sepFilter2D(wide, -1, kernel, kernel)[r : r + shape[0], r : r + shape[1]]


@lru_cache(maxsize=1024)
def _low_pass(length: float) -> np.ndarray:
    r = int(np.ceil(3 * length))
    kernel = np.exp(-0.5 * (np.arange(-r, r + 1) / length) ** 2)
    return (kernel / np.linalg.norm(kernel)).astype(np.float32)


def begins(state: MutableMapping[str, Any], frame) -> np.ndarray:
    """Return for each of the n images of a frame whether it is the first of an episode, (n,) bool.

    All are in the first call with a `state`, and if n has changed; else those with an earlier time than in the last
    call. `state` keeps the times, so call this once per frame.
    """
    now = np.broadcast_to(np.asarray(frame.time, float), (frame.n,))
    last = state.get("time")
    state["time"] = now.copy()
    return np.ones(frame.n, bool) if last is None or len(last) != frame.n else now < last


def persistent(
    state: MutableMapping[str, Any],
    frame,
    rows: np.ndarray,
    rng: Sequence[np.random.Generator],
    length: np.ndarray,
    rho: np.ndarray,
) -> np.ndarray:
    """Return a random field (len(rows), H, W) float32 of variance 1 for each of some images of a frame.

    From frame to frame it is a first-order autoregression, e <- rho e + sqrt(1 - rho^2) n with new noise n, so its
    correlation over k frames is rho^k. In the first frame of an episode it is new noise. Call this once per frame.

    Args:
        state: keeps the fields of all n images of a frame.
        frame: the frame.
        rows: indices of the images.
        rng: n random generators.
        length: (n,) px, as for `correlated`.
        rho: (n,) correlation of successive frames, 0 to 1.
    """
    opening = begins(state, frame)
    if "field" not in state or state["field"].shape != (frame.n, *frame.shape):
        state["field"] = np.zeros((frame.n, *frame.shape), np.float32)
        opening[:] = True
    field = state["field"]
    for row in rows:
        fresh = correlated(rng[row], frame.shape, float(length[row]))
        keep = 0.0 if opening[row] else float(rho[row])
        field[row] = np.float32(keep) * field[row] + np.float32(np.sqrt(1 - keep**2)) * fresh
    return field[rows]
