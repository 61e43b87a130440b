"""Depth pictures in figures: error by distance, lean, scatter, missing readings, and what happens beside borders.

Scatter is that of two readings of one pixel from one place, where the camera was held still: neighbours in a picture
share most of a stereo matcher's window, so that their difference shows half of its noise or less. Where nothing was
held still it is taken across the picture, from pixels too far apart to share a window.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.rules import RULES
from vispeg.identify.channels import shows
from vispeg.identify.pictures.figure import NEVER, Figure
from vispeg.identify.pictures.shots import Shot
from vispeg.vision.depth import depth_residual
from vispeg.worlds.world import World

NEARER = np.array([0.0, 0.12, 0.18, 0.25, 0.35, 0.5, 0.8])  # m: edges of the bins of distance; beyond is no cell
STEP = 0.03  # m by which the far side of a border lies behind for near things to grow over it
REACH = 8  # px beside a border
FEW = 60  # pixels that a figure needs
APART = 6  # px between pixels that share no matching window: half of the widest, 9 px, and a low-pass of 1.5
ORDINARY = (3e-4, 1e-3)  # m and 1/m: scatter s0 + s1 z^2 of a camera of which nothing is stated, of no effect
ERROR = "error at"  # how the names of errors begin; they are in m

RANGES = tuple(f"{near:g} to {far:g} m" for near, far in pairwise(NEARER))


def table() -> tuple[Figure, ...]:
    """Give the figures of depth: of errors the share of the distance that they may be."""
    repeats, differs = RULES.figure_depth
    return (
        *(Figure(f"{ERROR} {at}", repeats * far, differs * far) for at, far in zip(RANGES, NEARER[1:], strict=True)),
        *(Figure(f"lean {way}", *RULES.figure_lean) for way in ("across", "down")),
        *(Figure(f"scatter at {at}", *RULES.figure_scatter) for at in RANGES),
        Figure("missing", *RULES.figure_missing),
        Figure("run of missing", 0.5, NEVER),
        *(Figure(f"near part at {k + 1} px", *RULES.figure_near) for k in range(REACH)),
        *(Figure(f"missing at {k + 1} px", 0.1, NEVER) for k in range(REACH)),
    )


class DepthFigures:
    """Figures of the frames that have depth.

    Args:
        shots: the frames.
        ordinary: (2,) m and 1/m, scatter s0 + s1 z^2 that is of no effect.
    """

    def __init__(self, shots: Sequence[Shot], ordinary: tuple[float, float] = ORDINARY):
        self.table = table()
        self.shots, self.ordinary = [s for s in shots if s.depth is not None], ordinary
        self.measured = np.array([self._figures(s.depth, s.again, s) for s in self.shots if s.depth is not None])

    def modelled(self, world: World) -> np.ndarray:
        """Figures of the predicted depth after a world's effects on depth."""
        rows = []
        for s in self.shots:
            again = None if s.again is None else s.sensed(world, of_depth, draw=1)[1]
            rows.append(self._figures(s.sensed(world, of_depth)[1], again, s))
        return np.array(rows)

    def _figures(self, picture: np.ndarray, again: np.ndarray | None, shot: Shot) -> np.ndarray:
        return depth_figures(picture, shot, again, self.ordinary)


def of_depth(kind: Effect) -> bool:
    """Whether an effect is one of depth."""
    return shows(kind, "depth")


def depth_figures(
    picture: np.ndarray, shot: Shot, again: np.ndarray | None = None, ordinary: tuple[float, float] = ORDINARY
) -> np.ndarray:
    """Figures (as in `table`) of one depth picture (H, W) m, measured or modelled.

    Args:
        picture: the depth.
        shot: its frame.
        again: (H, W) m from the same place at another time, None where there is none.
        ordinary: (2,) m and 1/m, scatter s0 + s1 z^2 that is of no effect.
    """
    prediction, residual = shot.rendering, depth_residual(picture, shot.rendering)
    kind, z = np.digitize(prediction.depth, NEARER), prediction.depth
    inside = residual.interior & (kind < len(NEARER))
    good = inside & np.isfinite(residual.error)
    scatters = _in_time(picture, again) if again is not None else _across(residual.error)
    scatters[~good] = np.nan
    error, scatter = [], []
    for k in range(1, len(NEARER)):
        rows = good & (kind == k)
        enough = rows.sum() >= FEW
        error.append(float(np.median(residual.error[rows])) if enough else np.nan)
        some = scatters[rows & np.isfinite(scatters)]
        least = ordinary[0] + ordinary[1] * float(np.median(z[rows])) ** 2 if enough else 0.0
        scatter.append(
            float(np.log(np.hypot(np.median(some) / MEDIAN, least))) if enough and len(some) >= FEW else np.nan
        )
    lost = inside & (picture <= 0)
    starts = int((lost[:, 1:] & ~lost[:, :-1]).sum())
    gone = [
        lost.sum() / inside.sum() if inside.sum() >= FEW else np.nan,
        lost.sum() / starts if starts > 5 else np.nan,
    ]
    return np.concatenate([error, _lean(residual.error, good, shot), scatter, gone, _beside(picture, prediction.depth)])


MEDIAN = 0.6745  # of the size of a normal deviate, in standard deviations


def _in_time(picture: np.ndarray, again: np.ndarray) -> np.ndarray:
    """(H, W) m whose size scatters as one reading does; NaN where either has none."""
    return np.where((picture > 0) & (again > 0), np.abs(picture - again) / np.sqrt(2), np.nan)


def _across(error: np.ndarray) -> np.ndarray:
    """(H, W) m whose size scatters as one reading of independent ones does: what grows evenly cancels."""
    out = np.full(error.shape, np.nan)
    left, here, right = error[:, : -2 * APART], error[:, APART:-APART], error[:, 2 * APART :]
    out[:, APART:-APART] = np.abs(left - 2 * here + right) / np.sqrt(6)
    return out


def _lean(error: np.ndarray, good: np.ndarray, shot: Shot) -> np.ndarray:
    """(2,) m by which the error grows from the optical axis to 45 degrees right of it and below it, scale taken out."""
    some = np.zeros(good.shape, bool)
    some[::3, ::3] = True
    some &= good
    if some.sum() < FEW:
        return np.full(2, np.nan)
    rays, e, z = shot.rendering.eye.rays()[some], error[some].astype(float), shot.rendering.depth[some].astype(float)
    design = np.column_stack([rays[:, :2], z, np.ones(len(z))])
    design, keep = design - design.mean(0) * [1, 1, 1, 0], np.ones(len(z), bool)
    for _ in range(3):
        slope, *_ = np.linalg.lstsq(design[keep], e[keep], rcond=None)
        off = np.abs(e - design @ slope)
        keep = off <= 4 * max(float(np.median(off)), 1e-6)
    return slope[:2]


def _beside(picture: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(2 REACH,) by distance from a border on its far side: the share of readings of the near part, and of no reading.

    Of readings, not of pixels: what a sensor drops at a border it drops of either part.
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
