"""Estimate joint errors in each frame, so that a displaced edge is still matched to its border.

A camera on the hand sees the tool in the same place whatever the arm's errors, but the rest of the cell shifts from
frame to frame. Judged by the tool's edges alone, the noise would be a tenth of a pixel and the whole cell an outlier.
So the weight of each edge is computed after a robust fit of the posture in each frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.core.rules import RULES
from vispeg.identify.pictures.points import Points, misplacement, pixels
from vispeg.identify.pictures.robust import fit
from vispeg.identify.pictures.sight import Sight
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

SMALL = 1e-4  # rad, step of a derivative
SCALES = (1.0, 0.5, 0.3, 0.3)  # px, assumed scatter of the edges in successive robust steps


@dataclass(frozen=True, eq=False)
class Postures:
    """Joint errors of each frame, with prior standard deviation `posture_frame`.

    Attributes:
        frame: (n,) frame of each border point.
        slopes: (n, nj) px per rad, derivative of each point along its normal to each joint's error.
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
        """Return misplacements (n,) px less the effect of the frames' likeliest joint errors; NaN without an edge."""
        out, good = away.copy(), np.isfinite(away)
        for number in np.unique(self.frame[good]):
            rows = np.flatnonzero(good & (self.frame == number))
            slopes = self.slopes[rows]
            out[rows] -= slopes @ fit(slopes, away[rows], SCALES, 1 / RULES.posture_frame**2)
        return out


def steadied(geometry: Geometry, sight: Sight, world: World, points: Points) -> np.ndarray:
    """Return (n,) px from a world's borders to the edges, with the joint errors of each frame subtracted."""
    return Postures.of(geometry, sight, world, points).taken_out(misplacement(geometry, sight, world, points))
