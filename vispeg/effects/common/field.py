"""Noise fields over images: white noise low-passed in space, and its persistence from frame to frame."""

from __future__ import annotations

import math
from collections.abc import MutableMapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np


def words(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Independent uint16 numbers, uniform over 0 to 65535, from a generator of 64 bits (all of NumPy's but MT19937)."""
    size = math.prod(shape)
    return rng.bit_generator.random_raw((size + 3) // 4).view(np.uint16)[:size].reshape(shape)


def normal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Independent standard normal numbers, float32, through a table of 65536 quantiles; none is beyond +-4.3.

    A quarter of the time of NumPy's: a frame needs tens of thousands.
    """
    return _quantiles().take(words(rng, shape))


@lru_cache(maxsize=1)
def _quantiles() -> np.ndarray:
    from scipy.special import ndtri

    table = ndtri((np.arange(65536) + 0.5) / 65536)
    return (table / table.std()).astype(np.float32)


def correlated(rng: np.random.Generator, shape: tuple[int, int], length: float) -> np.ndarray:
    """Give a Gaussian field (H, W) float32 of mean 0 and variance 1, whose correlation falls as exp(-r^2 / (4
    length^2)).

    White noise through a Gaussian of standard deviation `length` px, divided by the kernel's norm. The noise is made
    wider than the image, so that the variance is the same at its border.
    """
    if length < 0.2:  # the kernel is a single pixel
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
    """Which images (n,) open an episode: the first ever, and those whose time is before that of the one before.

    To be asked once a frame.
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
    """Give a field (len(rows), H, W) of variance 1 for some images, of which each frame keeps a share `rho` of the
    last.

    First-order autoregression, e <- rho e + sqrt(1 - rho^2) n: its correlation over k frames is rho^k.
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
