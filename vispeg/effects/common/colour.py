"""Colours from hue, saturation and value, and from the temperature of a black body.

Sources: HSV, A. R. Smith, SIGGRAPH 1978; Planck's law integrated over the CIE 1931 colour matching functions as fitted
by C. Wyman, P.-P. Sloan and P. Shirley, JCGT 2(2), 2013 (multi-lobe fit); XYZ to linear sRGB, IEC 61966-2-1.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

FROM_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
WHITE = 6500.0  # K, white balance of a camera
SECOND_RADIATION = 1.438777e-2  # m K, CODATA 2018
# scale, centre (nm), inverse width below and above the centre (1/nm)
LOBES = (
    ((0.362, 442.0, 0.0624, 0.0374), (1.056, 599.8, 0.0264, 0.0323), (-0.065, 501.1, 0.0490, 0.0382)),
    ((0.821, 568.8, 0.0213, 0.0247), (0.286, 530.9, 0.0613, 0.0322)),
    ((1.217, 437.0, 0.0845, 0.0278), (0.681, 459.0, 0.0385, 0.0725)),
)


def rgb_of_hsv(h: ArrayLike, s: ArrayLike, v: ArrayLike) -> np.ndarray:
    """Return the colours (..., 3), RGB in [0, 1], of hue in turns, saturation and value, each (...)."""
    k = (np.array([5.0, 3.0, 1.0]) + 6 * np.asarray(h)[..., None]) % 6
    ramp = np.clip(np.minimum(k, 4 - k), 0, 1)
    return np.asarray(v)[..., None] * (1 - np.asarray(s)[..., None] * ramp)


def matching(nm: np.ndarray) -> np.ndarray:
    """Return the CIE 1931 colour matching functions x, y, z (3, n) at wavelengths (n,) in nm."""
    out = []
    for lobes in LOBES:
        total = np.zeros_like(nm)
        for scale, centre, below, above in lobes:
            t = (nm - centre) * np.where(nm < centre, below, above)
            total += scale * np.exp(-0.5 * t**2)
        out.append(total)
    return np.array(out)


@lru_cache(maxsize=4096)
def xyz_of_blackbody(kelvin: float) -> tuple[float, float, float]:
    """Return the CIE XYZ of a black body at this temperature, scaled to Y = 1."""
    nm = np.arange(360.0, 831.0, 5.0)
    radiance = nm**-5.0 / np.expm1(SECOND_RADIATION / (nm * 1e-9 * kelvin))
    x, y, z = matching(nm) @ radiance
    return float(x / y), 1.0, float(z / y)


def tint_of_blackbody(kelvin: float) -> np.ndarray:
    """Return the factors (3,) on encoded colours under a lamp of `kelvin`, for a white balance at WHITE.

    The greatest channel is 1: temperature changes colour, not brightness. The ratio of linear light is raised to
    1/2.2, because MuJoCo's renderer multiplies encoded colours.
    """
    ratio = (FROM_XYZ @ xyz_of_blackbody(kelvin)) / (FROM_XYZ @ xyz_of_blackbody(WHITE))
    ratio = np.maximum(ratio, 1e-3)
    return (ratio / ratio.max()) ** (1 / 2.2)
