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


@pytest.mark.parametrize("speed", [-0.003, 0.003])
def test_a_part_that_approaches_at_constant_speed_is_no_late_picture(speed):
    """Then the distances with the previous labels are constant too; which of the two scatters less is chance."""
    import trimesh

    camera, rng = Camera("wall", 64, 64, 60.0, 60.0, 31.5, 31.5), np.random.default_rng(0)
    box = trimesh.creation.box((0.06, 0.06, 0.04))
    mesh = np.asarray(box.vertices), np.asarray(box.faces)
    at = np.tile(np.eye(4), (30, 1, 1))
    at[:, 2, 3] = 0.4 + speed * np.arange(30)
    near = at[:, 2, 3, None, None] - 0.02  # its face, seen head-on
    mask = np.all(np.abs(camera.rays()[..., :2] * near[..., None]) < 0.03, axis=-1)
    depth = np.where(mask, near, WALL)
    for _ in range(8):
        noisy = depth + 3e-4 * rng.standard_normal(depth.shape)
        assert not len(late(Seen(camera, "box", noisy, mask, at, mesh))[0])
