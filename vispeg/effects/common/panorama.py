"""Panoramas: light from every direction, tone-mapped for the six faces of MuJoCo's skybox.

A panorama is (rows, 2 rows, 3) linear RGB: rows from the zenith down, columns along the azimuth, the middle column
towards the world's +x and the left edge towards -x; azimuth grows leftwards, as seen from inside.
Sources: E. Reinhard et al., Photographic tone reproduction, SIGGRAPH 2002, eqs. 1-3; faces as in OpenGL 4.6, 8.13, with
the sky turned by 90 deg about x so that z is up, as MuJoCo's reference says of skyboxes.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vispeg.effects.common.colour import rgb_of_hsv
from vispeg.effects.common.light import LUMA, to_srgb

KEY = 0.18  # middle grey, to which the mean luminance is mapped


@lru_cache(maxsize=4)
def directions(size: int) -> np.ndarray:
    """Return unit vectors (6 size, size, 3) towards the texels of a skybox, world frame, faces in MuJoCo's order."""
    t = (np.arange(size) + 0.5) / size * 2 - 1
    y, x = np.meshgrid(t, t, indexing="ij")
    ones = np.ones_like(x)
    faces = [(ones, -y, -x), (-ones, -y, x), (x, ones, y), (x, -ones, -y), (x, -y, ones), (-x, -y, -ones)]
    sky = np.concatenate([np.stack(f, axis=-1) for f in faces])  # y up
    world = np.stack([sky[..., 0], -sky[..., 2], sky[..., 1]], axis=-1)  # z up
    world /= np.linalg.norm(world, axis=-1, keepdims=True)
    world.flags.writeable = False
    return world


def look_up(panorama: np.ndarray, towards: np.ndarray, turn: float = 0.0) -> np.ndarray:
    """Return the light (..., 3) from directions (..., 3); the panorama is turned by `turn` rad about the vertical."""
    rows, columns = panorama.shape[:2]
    azimuth = np.arctan2(towards[..., 1], towards[..., 0]) - turn
    i = (np.arccos(np.clip(towards[..., 2], -1, 1)) / np.pi * rows).astype(int)
    j = np.floor((0.5 - azimuth / (2 * np.pi)) * columns).astype(int) % columns
    return panorama[np.minimum(i, rows - 1), j]


def tone_mapped(linear: np.ndarray, exposure: float = 0.0, level: float | None = None) -> np.ndarray:
    """Return sRGB in [0, 1]: the logarithmic mean becomes middle grey, highlights are compressed by L/(1 + L).

    Args:
        linear: (..., 3) linear light.
        exposure: stops by which the result is brighter.
        level: the luminance that is mapped to middle grey; that of `linear` (`log_mean`) if None.
    """
    bright = linear @ LUMA
    if level is None:
        level = log_mean(linear)
    scaled = linear * (KEY / level * 2.0**exposure)
    return to_srgb(scaled / (1 + bright * (KEY / level * 2.0**exposure))[..., None])


def log_mean(linear: np.ndarray) -> float:
    """Return exp of the mean logarithm of the luminance (eq. 1)."""
    return float(np.exp(np.mean(np.log(1e-6 + linear @ LUMA))))


def procedural(rng: np.random.Generator, rows: int = 64) -> np.ndarray:
    """Return a random panorama: colours of zenith, horizon and ground, up to eight dark objects, one to four lamps."""
    hue = rng.uniform(0, 1, 3)
    zenith, horizon, ground = rgb_of_hsv(hue, rng.uniform(0, 0.7, 3), rng.uniform((0.1, 0.2, 0.02), (1, 1, 0.4)))
    high = np.cos((np.arange(rows) + 0.5) / rows * np.pi)[:, None]  # sine of the elevation
    mix = np.abs(high) ** rng.uniform(0.3, 1.0)
    band = np.where(high > 0, horizon + mix * (zenith - horizon), horizon + mix * (ground - horizon))
    panorama = np.repeat(band[:, None], 2 * rows, axis=1)
    for _ in range(rng.integers(0, 9)):  # furniture, trees: standing on the ground, reaching above the horizon
        panorama[_window(rng, rows, (0.7, 1.7), (0.05, 0.3))] = rng.uniform(0.02, 0.3) * rng.uniform(0.5, 1, 3)
    for _ in range(rng.integers(1, 5)):
        lamp = rng.uniform(2, 20) * rgb_of_hsv(rng.uniform(), rng.uniform(0, 0.3), np.float64(1))
        panorama[_window(rng, rows, (0.2, 1.4), (0.05, 0.3))] = lamp
    return panorama.astype(np.float32)


def _window(rng: np.random.Generator, rows: int, zenith: tuple[float, float], half: tuple[float, float]) -> np.ndarray:
    """Return a mask (rows, 2 rows) of a random box of directions.

    The angle from the zenith of its centre and its half height are drawn from the ranges `zenith` and `half`, rad.
    """
    t = (np.arange(2 * rows) + 0.5) / rows * np.pi
    away = np.abs((t - rng.uniform(0, 2 * np.pi) + np.pi) % (2 * np.pi) - np.pi)
    inside = np.abs(t[:rows] - rng.uniform(*zenith)) < rng.uniform(*half)
    return inside[:, None] & (away < rng.uniform(0.05, 0.5))
