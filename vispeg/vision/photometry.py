"""The light channel: the difference of measured and predicted colour after a fitted gain and offset.

Exposure and white balance multiply linear light by one gain for each of red, green and blue; stray light adds an
offset. The rest remains: vignetting, blur, noise, and parts whose colour differs from the model's, which the robust fit
treats as outliers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.vision.predict import TO_LINEAR, Rendering, encoded

SATURATED = (2, 253)  # grey levels between which a pixel is not saturated
ROUNDS, CUT = 4, 3.0  # of the robust fit; pixels off by more than CUT sigma are outliers


@dataclass(frozen=True, eq=False)
class LightResidual:
    """One colour picture against its prediction.

    Attributes:
        error: (H, W, 3) grey levels, measured minus predicted after gain and offset; NaN where the picture is
            saturated.
        gain: (3,) measured over predicted linear light, red, green, blue.
        offset: (3,) linear light.
        inlier: share of the pixels, of all three colours, that are no outliers of the fit.
    """

    error: np.ndarray
    gain: np.ndarray
    offset: np.ndarray
    inlier: float


def light_residual(measured: np.ndarray, rendering: Rendering) -> LightResidual:
    """Subtract predicted from measured colour (H, W, 3) uint8, after the affine map of linear light that fits best."""
    light, predicted = TO_LINEAR[measured], TO_LINEAR[rendering.rgb]
    good = (measured > SATURATED[0]) & (measured < SATURATED[1]) & (rendering.parts > 0)[..., None]
    gain, offset, n_used = np.ones(3), np.zeros(3), 0
    for c in range(3):
        y, x = light[..., c][good[..., c]].astype(float), predicted[..., c][good[..., c]].astype(float)
        gain[c], offset[c], n = _affine(x, y)
        n_used += n
    matched = encoded(predicted * gain.astype(np.float32) + offset.astype(np.float32))
    error = np.where(good, measured.astype(np.float32) - matched, np.nan)
    return LightResidual(error, gain, offset, n_used / max(int(good.sum()), 1))


def _affine(x: np.ndarray, y: np.ndarray) -> tuple[float, float, int]:
    """Return gain and offset of y = gain x + offset fitted without outliers, and the number of other pixels."""
    keep, gain, offset = np.ones(len(x), bool), 1.0, 0.0
    for _ in range(ROUNDS):
        if keep.sum() < 10:
            return gain, offset, int(keep.sum())
        mean_x, mean_y = x[keep].mean(), y[keep].mean()
        spread = np.mean((x[keep] - mean_x) ** 2)
        if spread < 1e-8:  # of one colour, gain and offset cannot be distinguished
            return float(mean_y / max(mean_x, 1e-6)), 0.0, int(keep.sum())
        gain = float(np.mean((x[keep] - mean_x) * (y[keep] - mean_y)) / spread)
        offset = float(mean_y - gain * mean_x)
        off = np.abs(y - gain * x - offset)
        keep = off <= CUT * max(1.4826 * float(np.median(off)), 1e-3)
    return gain, offset, int(keep.sum())
