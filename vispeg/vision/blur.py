"""How soft borders are: the spread of light about an edge, from its answers to a narrow and a wide search.

A step blurred by a Gaussian of sigma b gives a search with a derivative of a Gaussian of sigma s the answer
s / sqrt(s^2 + b^2) of its height; the ratio of two answers is free of the height.
"""

from __future__ import annotations

import numpy as np

from vispeg.vision.borders import Borders
from vispeg.vision.search import STEP, Displacements, profiles, steps_along

NARROW, WIDE = 0.8, 2.4  # px, sigma of the searches
CONTRAST = 25.0  # grey levels, least step of an edge whose blur is measured


def softness(picture: np.ndarray, borders: Borders, displacements: Displacements) -> np.ndarray:
    """Return the sigma (n,) px of the Gaussian that blurs each border; NaN where it is weak, or was not found.

    A picture without blur has 0.3 px, as each pixel is a mean over its own width.
    """
    good = np.flatnonzero(
        (displacements.strength > CONTRAST) & np.isfinite(displacements.along) & (borders.free.min(axis=1) > 3 * WIDE)
    )
    out = np.full(len(borders), np.nan)
    if not len(good):
        return out
    clear, at = borders.some(good), displacements.along[good]
    answers = []
    for sigma in (NARROW, WIDE):
        reach = round(1.0 / STEP)
        half = int(np.ceil(3 * sigma / STEP))
        s = np.arange(-reach - half, reach + half + 1) * STEP
        answers.append(steps_along(profiles(picture, clear, s, at), sigma).max(axis=1))
    ratio = np.clip((answers[0] / np.maximum(answers[1], 1e-9)) ** 2, 1e-6, None)
    square = WIDE**2 * NARROW**2 * (1 - ratio) / np.maximum(WIDE**2 * ratio - NARROW**2, 1e-6)
    out[good] = np.sqrt(np.clip(square, 0.0, 100.0))
    return out
