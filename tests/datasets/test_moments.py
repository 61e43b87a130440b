"""Pictures against the moment of their labels: a ball of known motion before a wall, depth in closed form."""

import numpy as np
import pytest

from vispeg.datasets.moments import Seen, late
from vispeg.render.cameras.camera import Camera

RADIUS, WALL = 0.03, 1.2  # m


def pictures(camera, centres):
    """(T, H, W) m: depth of a ball at each centre in camera axes, before a wall; and the ball's pixels."""
    rays = camera.rays()
    out = []
    for centre in centres:
        b, c = rays @ centre, centre @ centre - RADIUS**2
        a = np.sum(rays**2, axis=-1)
        root = b**2 - a * c
        out.append(np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, WALL))
    depth = np.stack(out)
    return depth, depth < WALL


@pytest.mark.parametrize("labelled", [True, False], ids=["mask", "no mask"])
@pytest.mark.parametrize("behind", [0, 1], ids=["in time", "late"])
def test_late_pictures_are_found_with_and_without_a_mask(labelled, behind):
    import trimesh

    camera = Camera("wall", 160, 120, 140.0, 140.0, 79.5, 59.5)
    t = np.arange(24)
    centres = np.stack([0.05 * np.sin(0.5 * t), 0.02 * np.cos(0.3 * t), 0.6 + 0.02 * np.sin(0.8 * t)], axis=1)
    shown = centres.copy()
    shown[8:16] = centres[8 - behind : 16 - behind]  # eight pictures of the moment before
    depth, mask = pictures(camera, shown)
    at = np.tile(np.eye(4), (len(t), 1, 1))
    at[:, :3, 3] = centres
    ball = trimesh.creation.icosphere(4, RADIUS)
    mesh = np.asarray(ball.vertices), np.asarray(ball.faces)
    found, own, before = late(Seen(camera, "ball", depth, mask if labelled else None, at, mesh))
    assert set(found) <= set(range(8, 16)) and (len(found) >= 5) == bool(behind)
    if behind:
        assert own > 0.003 > 0.001 > before
