"""Labels: normals of planes and balls, parts that have their names, poses in the camera's own axes."""

import numpy as np
import pytest
from spheres import AXES, BALLS, EYE, POS, RADIUS, model, outline

from vispeg.core.errors import UserError
from vispeg.render.backends.backend import Renderer
from vispeg.render.cameras.standard import square, standard_cameras
from vispeg.render.labels import normals_of, part_table
from vispeg.robots.scene import build

OVER = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0, 0.0])


@pytest.mark.parametrize("normal", [(0, 0, -1), (0.3, 0.2, -0.9), (-0.6, 0.1, -0.5)])
def test_a_plane_has_one_normal_everywhere(normal):
    camera = square("eye", 60.0)
    n = np.array(normal) / np.linalg.norm(normal)
    depth = (n @ np.array([0, 0, 0.7])) / (camera.rays() @ n)
    depth[5, 5] = 0  # a hole in the depth stays one, and its neighbours keep their normals
    found = normals_of(depth, camera)
    assert (found[5, 5] == 0).all()
    found[5, 5] = n
    np.testing.assert_allclose(found, np.broadcast_to(n, found.shape), atol=1e-5)


def test_an_edge_does_not_smear():
    camera = square("eye", 60.0)
    depth = np.full((64, 64), 0.5)
    depth[:, 30:] = 0.9
    np.testing.assert_allclose(normals_of(depth, camera), np.broadcast_to([0, 0, -1.0], (64, 64, 3)), atol=1e-6)


@pytest.mark.parametrize("kind", ["classic", "raycast"])
def test_a_balls_normals_point_away_from_its_centre(kind):
    with Renderer(model(), [EYE], kind, labels=True) as renderer:
        shot = renderer.render()["eye"]
    for i, (x, y) in enumerate(np.rint(outline(EYE)).astype(int)):
        at = EYE.points(shot.depth)[y - 5 : y + 6, x - 5 : x + 6]
        expected = (at - BALLS[i]) / RADIUS
        cosine = (expected * shot.normals[y - 5 : y + 6, x - 5 : x + 6]).sum(-1)
        assert cosine.min() > (0.99999 if kind == "raycast" else 0.98)  # OpenGL's ball has facets


def test_normals_are_made_when_asked_for_and_only_then():
    with Renderer(model(), [EYE], "classic", labels=True) as renderer:
        shot = renderer.render()["eye"]
    expected = normals_of(shot.depth, EYE)
    shot.depth[:] = 0  # the caller's to change
    assert "normals" not in vars(shot)
    np.testing.assert_array_equal(shot.normals, expected)
    assert shot.normals is shot.normals


def test_parts_have_the_labels_of_their_order():
    cell = build()
    cameras = standard_cameras(cell.tip, cell.config.fixture)
    number = {part: i for i, part in enumerate(cell.parts, start=1)}
    with Renderer(cell, cameras, "classic", labels=True) as renderer:
        shots = renderer.render(OVER)
        assert shots["wrist_crop"].segmentation[31, 31] in (number["peg"], number["table"])
        assert (shots["wrist_crop"].segmentation[:16, 28:36] == number["peg"]).all()
        at = cameras[2].project(shots["external"].poses["hole"][:3, 3] + [0, 0, 0])
        np.testing.assert_allclose(at, 31.5, atol=1e-6)  # the external camera looks at the hole
        near = shots["external"].segmentation[28:36, 28:36]
        assert (near == number["fixture"]).all()
        assert number["distractors"] not in shots["external"].segmentation  # parked
        tip = shots["wrist_wide"].poses["peg_tip"]
        np.testing.assert_allclose(cameras[0].project(tip[:3, 3]), 31.5, atol=1e-6)
        np.testing.assert_allclose(tip[:3, :3] @ tip[:3, :3].T, np.eye(3), atol=1e-12)
        assert set(shots["external"].poses) == {"peg", "peg_tip", "fixture", "hole"}
        block = shots["external"].pose @ shots["external"].poses["fixture"]
        np.testing.assert_allclose(block[:3, 3], renderer.data.body("fixture").xpos, atol=1e-12)
        in_base = shots["wrist_wide"].pose @ shots["wrist_wide"].poses["hole"]
        np.testing.assert_allclose(in_base[:3, 3], cell.config.fixture, atol=1e-12)
    with Renderer(cell, cameras, "classic") as renderer:
        shot = renderer.render(OVER)["external"]
        assert shot.segmentation is None and shot.normals is None and shot.poses is None


def test_the_pose_of_a_camera_on_the_base_is_what_it_says():
    with Renderer(model(), [EYE], "raycast") as renderer:
        pose = renderer.render()["eye"].pose
    np.testing.assert_allclose(pose[:3, :3], AXES, atol=1e-12)
    np.testing.assert_array_equal(pose[:3, 3], POS)


def test_parts_of_geoms_that_are_not_there():
    with pytest.raises(UserError, match="parts.peg"):
        part_table(model(), {"peg": ("ball0", "peg")})
    np.testing.assert_array_equal(part_table(model(), {"a": ("ball1",), "b": ("ball0", "ball4")}), [2, 1, 0, 0, 2, 0])
    np.testing.assert_array_equal(part_table(model(), None), [1, 2, 3, 4, 5, 0])
