"""Border points of a camera of the cell whose pixels, depths and normals a test chooses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.api.recording.look import cameras_of, scene_of
from vispeg.identify.pictures.points import Points
from vispeg.identify.pictures.sight import Sight
from vispeg.recordings.cell import CellBelief
from vispeg.task.start import home
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

CELL = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))
WRIST = "wrist_wide"


def seen(size: tuple[int, int]) -> tuple[Geometry, Sight]:
    """Return the cell with a wrist camera of `size` (width, height) px, and a sight with one frame at home."""
    scene = scene_of(CELL)
    (camera,) = cameras_of([WRIST], scene, size)
    posture = home(scene)
    geometry = Geometry(scene, [camera])
    geometry.at(posture)
    still = np.zeros(1)
    return geometry, Sight(
        "still", camera, still, lambda t, _: np.tile(posture, (len(t), 1)), lambda i: None, lambda i: None
    )


def points_at(
    geometry: Geometry, pixel: np.ndarray, normal: np.ndarray, depth: np.ndarray | Sequence[float] | float = 0.5
) -> Points:
    """Points of the world at pixels (n, 2) of the first frame and depths in m, each on an edge."""
    n, frame = len(pixel), np.zeros(len(pixel), int)
    depths = np.broadcast_to(np.asarray(depth, float), (n,))
    body, local = geometry.local(WRIST, pixel, depths, np.full(n, -1))
    return Points(frame, body, local, np.asarray(pixel, float), normal, np.zeros(n), np.zeros((n, 2), int), depths)
