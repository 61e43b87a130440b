"""Summarise depth pictures: error by distance, tilt, noise, missing readings, and behaviour beside borders.

Noise is estimated from two readings of one pixel from the same place, if the camera was held still. Neighbouring
pixels share most of a stereo matcher's window, so their difference shows half of the noise or less. If the camera
never stood still, noise is estimated from pixels too far apart to share a window.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.rules import RULES
from vispeg.identify.channels import shows
from vispeg.identify.pictures.figure import Figure
from vispeg.identify.pictures.shots import Shot
from vispeg.vision.depth import depth_residual
from vispeg.worlds.world import World

NEARER = np.array([0.0, 0.12, 0.18, 0.25, 0.35, 0.5, 0.8])  # m: edges of the distance bins; the cell is nearer
MIDDLE = NEARER[len(NEARER) // 2]  # m, the distance for which a lean is judged
STEP = 0.03  # m, depth step of a border at which the near part may bleed onto the far one
REACH = 8  # px on each side of a border
FEW = 60  # fewest pixels for a figure
APART = 6  # px between pixels without a common matching window: half the widest, 9 px, plus 1.5 of blur
ORDINARY = (3e-4, 1e-3)  # m and 1/m: noise s0 + s1 z^2 of a camera with no stated noise
ERROR = "error at"  # prefix of the names of depth errors, in m

RANGES = tuple(f"{near:g} to {far:g} m" for near, far in pairwise(NEARER))


def table() -> tuple[Figure, ...]:
    """Return the figures of depth; the scale of an error is relative to the distance.

    A border that is off by a share of a pixel shows the near part in as large a share of the pixels beside it.
    """
    return (
        *(Figure(f"{ERROR} {at}", RULES.figure_depth * far) for at, far in zip(RANGES, NEARER[1:], strict=True)),
        *(Figure(f"lean {way}", RULES.figure_depth * MIDDLE) for way in ("across", "down")),
        *(Figure(f"scatter at {at}", RULES.figure_noise) for at in RANGES),
        Figure("missing", RULES.figure_missing),
        Figure("run of missing", 2.0, counts=False),
        *(Figure(f"near part at {k + 1} px", RULES.shift_px) for k in range(REACH)),
        *(Figure(f"missing at {k + 1} px", 2 * RULES.shift_px, counts=False) for k in range(REACH)),
    )


class DepthFigures:
    """Figures of the frames that have depth.

    Args:
        shots: the frames.
        ordinary: (2,) m and 1/m, noise s0 + s1 z^2 that counts as no effect.
    """

    def __init__(self, shots: Sequence[Shot], ordinary: tuple[float, float] = ORDINARY):
        self.table = table()
        self.shots, self.ordinary = [s for s in shots if s.depth is not None], ordinary
        self.measured = np.array([self._figures(s.depth, s.again, s) for s in self.shots if s.depth is not None])

    def modelled(self, world: World) -> np.ndarray:
        """Return the figures of the predicted depth after a world's effects on depth."""
        rows = []
        for s in self.shots:
            again = None if s.again is None else s.sensed(world, of_depth, draw=1)[1]
            rows.append(self._figures(s.sensed(world, of_depth)[1], again, s))
        return np.array(rows)

    def _figures(self, picture: np.ndarray, again: np.ndarray | None, shot: Shot) -> np.ndarray:
        return depth_figures(picture, shot, again, self.ordinary)


def of_depth(kind: Effect) -> bool:
    """Return whether an effect acts on depth."""
    return shows(kind, "depth")


def depth_figures(
    picture: np.ndarray, shot: Shot, again: np.ndarray | None = None, ordinary: tuple[float, float] = ORDINARY
) -> np.ndarray:
    """Compute the figures (as in `table`) of one depth picture (H, W) m, measured or modelled.

    Args:
        picture: the depth.
        shot: its frame.
        again: (H, W) m, another reading from the same place; None if there is none.
        ordinary: (2,) m and 1/m, noise s0 + s1 z^2 that counts as no effect.
    """
    prediction, residual = shot.rendering, depth_residual(picture, shot.rendering)
    bins, z = np.digitize(prediction.depth, NEARER), prediction.depth
    inside = residual.interior & (bins < len(NEARER))
    good = inside & np.isfinite(residual.error)
    scatters = _in_time(picture, again) if again is not None else _across(residual.error)
    scatters[~good] = np.nan
    error, scatter = [], []
    for k in range(1, len(NEARER)):
        rows = good & (bins == k)
        enough = rows.sum() >= FEW
        error.append(float(np.median(residual.error[rows])) if enough else np.nan)
        of_bin = scatters[rows & np.isfinite(scatters)]
        least = ordinary[0] + ordinary[1] * float(np.median(z[rows])) ** 2 if enough else 0.0
        scatter.append(
            float(np.log(np.hypot(np.median(of_bin) / MEDIAN, least))) if enough and len(of_bin) >= FEW else np.nan
        )
    lost = inside & (picture <= 0)
    starts = int((lost[:, 1:] & ~lost[:, :-1]).sum())
    gone = [
        lost.sum() / inside.sum() if inside.sum() >= FEW else np.nan,
        lost.sum() / starts if starts > 5 else np.nan,
    ]
    return np.concatenate([error, _lean(residual.error, good, shot), scatter, gone, _beside(picture, prediction.depth)])


MEDIAN = 0.6745  # median of |x| for a standard normal x


def _in_time(picture: np.ndarray, again: np.ndarray) -> np.ndarray:
    """Return a difference of two readings, (H, W) m, scaled to one reading's noise; NaN where either is missing."""
    return np.where((picture > 0) & (again > 0), np.abs(picture - again) / np.sqrt(2), np.nan)


def _across(error: np.ndarray) -> np.ndarray:
    """Return a second difference across the picture, (H, W) m, scaled to one reading's noise; linear trends cancel."""
    out = np.full(error.shape, np.nan)
    left, here, right = error[:, : -2 * APART], error[:, APART:-APART], error[:, 2 * APART :]
    out[:, APART:-APART] = np.abs(left - 2 * here + right) / np.sqrt(6)
    return out


def _lean(error: np.ndarray, good: np.ndarray, shot: Shot) -> np.ndarray:
    """Return the tilt (2,) m: how much the error grows from the optical axis to 45 degrees to the right, and down.

    An error of scale does not count.
    """
    used = np.zeros(good.shape, bool)
    used[::3, ::3] = True
    used &= good
    if used.sum() < FEW:
        return np.full(2, np.nan)
    rays, e, z = shot.rendering.eye.rays()[used], error[used].astype(float), shot.rendering.depth[used].astype(float)
    design = np.column_stack([rays[:, :2], z, np.ones(len(z))])
    design, keep = design - design.mean(0) * [1, 1, 1, 0], np.ones(len(z), bool)  # centred, except the constant
    for _ in range(3):
        slope, *_ = np.linalg.lstsq(design[keep], e[keep], rcond=None)
        off = np.abs(e - design @ slope)
        keep = off <= 4 * max(float(np.median(off)), 1e-6)
    return slope[:2]


def _beside(picture: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return shares of near-part readings and of missing ones by distance from a border, far side, (2 REACH,).

    The shares are of readings, not of pixels, because a sensor drops readings of either part at a border.
    """
    import cv2

    far = np.where(true > 0, true, 8.0).astype(np.float32)
    grown, front = np.ones((3, 3), np.uint8), far
    near, done = np.full((2, REACH), np.nan), np.zeros(far.shape, bool)
    for px in range(REACH):
        front = cv2.erode(front, grown)
        band = (far - front > STEP) & ~done & (true > 0) & (front < NEARER[-1])
        done |= band
        if band.sum() >= FEW:
            middle = (far + front) / 2
            read, lost = (picture > 0) & (picture < middle), picture <= 0
            readings = int((band & ~lost).sum())
            near[0, px] = (band & read).sum() / readings if readings >= FEW / 2 else np.nan
            near[1, px] = lost[band].mean()
    return near.ravel()
