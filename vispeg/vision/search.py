"""Find predicted borders in a picture: the strongest step of colour along each normal, to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.core.rules import RULES
from vispeg.vision.borders import Borders
from vispeg.vision.predict import TO_LINEAR

STEP = 0.25  # px between samples of a profile
BESIDE = (-1.0, 0.0, 1.0)  # px along the border that are averaged
SMOOTH = 1.0  # px, sigma of the derivative of a Gaussian that steps are looked for with
SHARE = 0.6  # of the way to the next predicted border that is searched


@dataclass(frozen=True, eq=False)
class Displacements:
    """How far borders lie from where they were predicted, measured minus predicted, (n,) each.

    Attributes:
        along: px along the normal; NaN where no step was found.
        strength: grey levels that the step goes over.
    """

    along: np.ndarray
    strength: np.ndarray


def search(picture: np.ndarray, borders: Borders, window: float = 8.0, noise: float | None = None) -> Displacements:
    """Look for each border in a picture, from `window` px before it to as many behind.

    Args:
        picture: (H, W, 3) uint8, as measured.
        borders: as predicted.
        window: px; less towards a neighbouring border, so that one is not taken for the other.
        noise: grey levels, 1-sigma of the picture; estimated where not given.
    """
    n = len(borders)
    if not n:
        return Displacements(np.zeros(0), np.zeros(0))
    noise = noise_of_picture(picture) if noise is None else noise
    half = int(np.ceil(3 * SMOOTH / STEP))
    s = np.arange(-round(window / STEP) - half, round(window / STEP) + half + 1) * STEP
    size, s = steps_along(profiles(picture, borders, s), SMOOTH), s[half:-half]
    low, high = (np.minimum(window, np.maximum(1.0, SHARE * borders.free[:, k])) for k in (0, 1))
    inside = (s >= -low[:, None] - 1e-9) & (s <= high[:, None] + 1e-9)
    prior = np.exp(-0.5 * (s / (0.7 * window)) ** 2)  # favours a step near the prediction
    peak = np.zeros_like(inside)
    peak[:, 1:-1] = (size[:, 1:-1] >= size[:, :-2]) & (size[:, 1:-1] > size[:, 2:])
    score = np.where(inside & peak, size * prior, 0.0)
    best, rows = score.argmax(1), np.arange(n)
    strength = np.where(score[rows, best] > 0, size[rows, best], 0.0)
    # of three colours together; the samples within a pixel share its noise
    grain = noise * np.linalg.norm(_kernel(SMOOTH)) * np.sqrt(3 / (STEP * len(BESIDE)))
    good = strength > max(RULES.edge_step, RULES.edge_times * grain)
    along = np.where(good, s[best] + _finer(picture, borders, s[best]), np.nan)
    return Displacements(along, strength)


def _finer(picture: np.ndarray, borders: Borders, middle: np.ndarray) -> np.ndarray:
    """Return (n,) px from `middle` (n,) px along the normals to the steepest place of the light there, within a pixel.

    A pixel that a border crosses holds the mean of both sides' light. Code values are not linear in light; they would
    put the border towards the darker side.
    """
    light, half = TO_LINEAR[picture], int(np.ceil(3 * SMOOTH / STEP))
    near = round(1 / STEP)
    s = np.arange(-near - half, near + half + 1) * STEP
    size, rows = steps_along(profiles(light, borders, s, middle), SMOOTH), np.arange(len(borders))
    best = np.clip(size.argmax(1), 1, 2 * near - 1)
    left, centre, right = (size[rows, best + k] for k in (-1, 0, 1))
    bend = left - 2 * centre + right
    shift = np.where(bend < 0, 0.5 * (left - right) / np.minimum(bend, -1e-12), 0.0)
    return STEP * (best - near + np.clip(shift, -1, 1))


def noise_of_picture(picture: np.ndarray) -> float:
    """Return the noise of a picture (H, W, 3), 1-sigma in grey levels, by a mask that no edge and no slope excites.

    Source: Immerkaer, "Fast noise variance estimation", CVIU 64(2), 1996; here a median in place of the mean leaves
    edges out.
    """
    import cv2

    grey = picture.astype(np.float32).mean(axis=2)
    mask = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    away = np.abs(cv2.filter2D(grey, -1, mask))[1:-1, 1:-1]
    return float(np.median(away) / 0.6745 / 6.0 * np.sqrt(picture.shape[2]))


def profiles(picture: np.ndarray, borders: Borders, s: np.ndarray, middle: np.ndarray | None = None) -> np.ndarray:
    """Return grey levels (n, len(s), C) at `s` px along the normals, averaged over `BESIDE` along the border.

    `middle` (n,) px along the normal is what `s` counts from, 0 if not given.
    """
    import cv2

    image = picture.astype(np.float32)
    tangent = np.stack([-borders.normal[:, 1], borders.normal[:, 0]], 1)
    begin = borders.pixel if middle is None else borders.pixel + middle[:, None] * borders.normal
    out = np.zeros((len(borders), len(s), picture.shape[2]), np.float32)
    for beside in BESIDE:
        at = begin[:, None] + s[:, None] * borders.normal[:, None] + beside * tangent[:, None]
        u, v = at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)
        for first in range(0, len(at), 8192):  # OpenCV's maps have at most 32767 rows
            part = slice(first, first + 8192)
            out[part] += cv2.remap(image, u[part], v[part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return out / len(BESIDE)


def steps_along(rows: np.ndarray, sigma: float) -> np.ndarray:
    """Return the steps (n, m - k + 1), grey levels, along profiles (n, m, C), all colours together.

    k is the length of the kernel, a derivative of a Gaussian of `sigma` px.
    """
    kernel = _kernel(sigma)
    windows = np.lib.stride_tricks.sliding_window_view(rows, len(kernel), axis=1)  # (n, m - k + 1, C, k)
    return np.linalg.norm(windows @ kernel, axis=-1)


def _kernel(sigma: float) -> np.ndarray:
    """Return the derivative of a Gaussian over samples `STEP` px apart; a step of one grey level gives one."""
    half = int(np.ceil(3 * sigma / STEP))
    offsets = np.arange(-half, half + 1) * STEP
    kernel = offsets * np.exp(-0.5 * (offsets / sigma) ** 2)
    return kernel / (np.abs(kernel).sum() / 2)
