"""Joint errors in each frame, allowed for so that a displaced edge is still matched to its border.

A camera in the hand sees the tool in one place, however the arm errs, and the cell elsewhere in every frame. By the
tool's edges alone the noise is a tenth of a pixel, and all of the cell an outlier. So how far an edge may be trusted is
asked after each frame's posture was fitted to its edges, robustly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.core.rules import RULES
from vispeg.identify.pictures.points import Points, misplacement, pixels
from vispeg.identify.pictures.robust import trust
from vispeg.identify.pictures.sight import Sight
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

SMALL = 1e-4  # rad: step of a derivative
SCALES = (1.0, 0.5, 0.3, 0.3)  # px that edges may scatter by, from one robust step to the next


@dataclass(frozen=True, eq=False)
class Postures:
    """The joints of each frame, free within `posture_frame` of what was measured.

    Attributes:
        frame: (n,) that each border point belongs to.
        slopes: (n, nj) px a rad, by which an error of each joint moves a point along its normal.
    """

    frame: np.ndarray
    slopes: np.ndarray

    @classmethod
    def of(cls, geometry: Geometry, sight: Sight, world: World, points: Points) -> Postures:
        """Build from the points of a sight, linearised at a world."""
        here, nj = pixels(geometry, sight, world, points), len(geometry.scene.joints)
        moved = [pixels(geometry, sight, world, points, SMALL * axis) - here for axis in np.eye(nj)]
        along = [np.nan_to_num(np.sum(m * points.normal, axis=1)) / SMALL for m in moved]
        return cls(points.frame, np.stack(along, axis=1))

    def taken_out(self, away: np.ndarray) -> np.ndarray:
        """Misplacements (n,) px, NaN where there is no edge, less what each frame's most likely posture does."""
        out, good = away.copy(), np.isfinite(away)
        for number in np.unique(self.frame[good]):
            rows = np.flatnonzero(good & (self.frame == number))
            r, slopes = away[rows], self.slopes[rows]
            for scale in SCALES:
                root = np.sqrt(trust(out[rows], scale))[:, None] / scale
                out[rows] = r - slopes @ _posture(root * slopes, root[:, 0] * r)
        return out


def _posture(slopes: np.ndarray, away: np.ndarray) -> np.ndarray:
    """(nj,) rad that make `away` (n,) of slopes (n, nj), both weighted, most likely."""
    return np.linalg.solve(slopes.T @ slopes + np.eye(slopes.shape[1]) / RULES.posture_frame**2, slopes.T @ away)


def steadied(geometry: Geometry, sight: Sight, world: World, points: Points) -> np.ndarray:
    """(n,) px: how far the edges of a sight are off a world's borders, the arm's errors in each frame taken out."""
    return Postures.of(geometry, sight, world, points).taken_out(misplacement(geometry, sight, world, points))
