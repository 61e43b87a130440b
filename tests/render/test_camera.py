"""Cameras: projection against OpenCV's, lenses that can be undone, files that come back, and what no camera can be."""

import cv2
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vispeg.api.cameras import field_of
from vispeg.core.errors import UserError
from vispeg.core.lens import distort, undistort
from vispeg.core.rotation import quaternion
from vispeg.core.seeds import stream
from vispeg.render.cameras import model_camera
from vispeg.render.cameras.camera import Camera, looking_at, rotation
from vispeg.render.cameras.camera_files import load_camera, load_cameras, save_cameras
from vispeg.render.cameras.standard import CROP_SCALE, WIDE_FOV, standard_cameras

LENS = (-0.12, 0.03, 0.001, -0.002, 0.004)
CAMERA = Camera("eye", 64, 48, 60.25, 61.5, 30.125, 25.75, LENS, "flange", (0.1, -0.2, 0.3), (0.5, -0.5, 0.5, 0.5))


def test_projects_as_opencv_does():
    points = stream(0, "points").normal(size=(50, 3)) * 0.4 + [0, 0, 2]
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), CAMERA.K, np.array(LENS))[0][:, 0]
    np.testing.assert_allclose(CAMERA.project(points), expected, atol=1e-9)
    assert np.isnan(CAMERA.project(np.array([0.0, 0.0, -1.0]))).all()


@given(st.floats(-0.1, 0.1), st.floats(-0.02, 0.02), st.floats(-0.005, 0.005), st.floats(-0.005, 0.005))
def test_a_lens_undone_is_the_pixel_again(k1, k2, p1, p2):
    camera = CAMERA.moved(distortion=(k1, k2, p1, p2, 0.0))
    rays, pixels = camera.rays(), np.stack(np.meshgrid(np.arange(64), np.arange(48)), -1)
    np.testing.assert_allclose(camera.project(rays * 1.7), pixels, atol=1e-7)


def test_the_field_of_view_is_what_the_edges_see():
    """Through the lens, and about a principal point that is not in the middle."""
    assert field_of(Camera("eye", 64, 48, 60.0, 60.0, 31.5, 23.5)) == pytest.approx((56.145, 43.603), abs=1e-3)
    camera = Camera("eye", 64, 48, 60.0, 60.0, 9.5, 23.5, (-0.12, 0.03, 0.0, 0.0, 0.0))
    for axis, (edge, other) in enumerate((([-0.5, 23.5], [63.5, 23.5]), ([9.5, -0.5], [9.5, 47.5]))):
        across, down = np.radians(field_of(camera))
        first = np.append(camera.ideal(np.array(edge)), 1.0)
        turn = Rotation.from_rotvec([0.0, across, 0.0] if axis == 0 else [-down, 0.0, 0.0])
        x, y, z = turn.apply(first)  # the first edge's ray, turned by the field of view, is the other edge's
        np.testing.assert_allclose(camera.project(np.array([x, y, z])), other, atol=1e-6)


def test_where_the_lens_folds_back_no_ray_leads():
    """A barrel with k1 = -0.2 shows radii up to 2/3 sqrt(1 / 0.6) only: the rest of its image has no ray."""
    radius = np.array([0.3, 0.8, 0.87, 2.0])
    seen = undistort(np.stack([radius, np.zeros(4)], -1), (-0.2, 0.0, 0.0, 0.0, 0.0))
    assert np.isnan(seen).all(-1).tolist() == (radius > 2 / 3 * np.sqrt(1 / 0.6)).tolist()


def test_a_point_without_a_solution_does_not_stop_the_others():
    """The first point is outside the barrel's image and diverges after a few steps; the others have a solution."""
    lens, seen = (-0.25, 0.0, 0.0, 0.0, 0.0), np.array([[2.0, 0.0], [0.3, 0.2], [0.5, 0.1]])
    ideal = undistort(seen, lens)
    assert np.isnan(ideal[0]).all()
    np.testing.assert_array_equal(ideal[1:], undistort(seen[1:], lens))
    np.testing.assert_allclose(distort(ideal[1:], lens), seen[1:], atol=1e-12)
    assert undistort(np.zeros((0, 2)), lens).shape == (0, 2)


def test_the_lens_moves_pixels_and_a_pinhole_does_not():
    plain = CAMERA.moved(distortion=(0, 0, 0, 0, 0))
    assert np.abs(CAMERA.rays() - plain.rays()).max() > 2 / 60  # two pixels in a corner
    np.testing.assert_array_equal(plain.rays()[25, 30, :2] * (60.25, 61.5) + (30.125, 25.75), (30, 25))


def test_depth_becomes_points_that_project_back():
    depth = np.full((48, 64), 0.7, np.float32)
    depth[3, 4] = 0
    points = CAMERA.points(depth)
    assert (points[3, 4] == 0).all() and points[..., 2].max() == np.float32(0.7)
    np.testing.assert_allclose(CAMERA.project(points[10, 20]), (20, 10), atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_rotations_agree_with_scipy(seed):
    q = Rotation.random(random_state=seed)
    w = np.roll(q.as_quat(canonical=True), 1)
    np.testing.assert_allclose(rotation(w), q.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(quaternion(q.as_matrix()), w, atol=1e-12)


def test_looking_at_puts_the_target_on_the_axis_and_up_upwards():
    at, target, up = np.array([0.3, -0.2, 0.9]), np.array([0.6, 0.1, 0.05]), np.array([0.0, 0.0, 1.0])
    axes = rotation(looking_at(at, target, up))
    seen = axes.T @ (target - at)
    np.testing.assert_allclose(seen[:2], 0, atol=1e-12)
    assert seen[2] > 0 and (axes.T @ up)[1] < 0 and np.linalg.det(axes) == pytest.approx(1)
    with pytest.raises(UserError, match="up"):
        looking_at(np.zeros(3), up, up)


def test_standard_cameras_do_what_they_are_for():
    wide, crop, external = standard_cameras()
    tip = np.array([0, 0, 0.185])
    for camera in (wide, crop):
        seen = camera.rotation.T @ (tip - camera.pos)
        np.testing.assert_allclose(camera.project(seen), 31.5, atol=1e-9)
    assert np.linalg.norm(tip - crop.pos) / crop.fx == pytest.approx(CROP_SCALE) and CROP_SCALE <= 0.5e-3
    assert 2 * np.degrees(np.arctan(32 / wide.fx)) == pytest.approx(WIDE_FOV)
    assert external.parent == "base" and {c.width for c in (wide, crop, external)} == {64}


@pytest.mark.parametrize("style", ["vispeg", "opencv", "ros"])
def test_files_come_back_bit_for_bit(tmp_path, style):
    back = load_camera(save_cameras(tmp_path / "camera.yaml", CAMERA, style=style))
    kept = CAMERA if style == "vispeg" else CAMERA.moved(parent="base", pos=(0, 0, 0), quat=(1, 0, 0, 0))
    assert back == kept
    with pytest.raises(UserError, match="exists already"):
        save_cameras(tmp_path / "camera.yaml", CAMERA, style=style)


def test_opencv_reads_what_we_write_and_we_what_it_writes(tmp_path):
    ours, theirs = str(save_cameras(tmp_path / "ours.yaml", CAMERA, style="opencv")), str(tmp_path / "theirs.yaml")
    store = cv2.FileStorage(ours, cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(store.getNode("camera_matrix").mat(), CAMERA.K)
    np.testing.assert_array_equal(store.getNode("distortion_coefficients").mat().ravel(), LENS)
    store = cv2.FileStorage(theirs, cv2.FILE_STORAGE_WRITE)
    store.write("image_width", 64)
    store.write("fisheye_model", 0)  # as OpenCV's own calibration writes of a lens of Brown's
    store.write("image_height", 48)
    store.write("camera_matrix", CAMERA.K)
    store.write("distortion_coefficients", np.array([LENS]))
    store.release()
    back = load_camera(theirs)
    assert (back.name, back.width, back.height, back.distortion) == ("theirs", 64, 48, LENS)
    np.testing.assert_array_equal(back.K, CAMERA.K)


def test_several_cameras_in_one_file(tmp_path):
    cameras = standard_cameras()
    path = save_cameras(tmp_path / "cell.yaml", cameras)
    assert load_cameras(path) == cameras
    with pytest.raises(UserError, match="several cameras.*wrist_wide.*external"):
        load_camera(path)
    with pytest.raises(UserError, match="holds one camera"):
        save_cameras(tmp_path / "ros.yaml", cameras, style="ros")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"fx": -60}, "impossible fx"),
        ({"fy": float("nan")}, "impossible fy"),
        ({"fx": 0.5}, "impossible fx"),
        ({"width": 64.5}, "impossible width"),
        ({"height": 10**6}, "impossible height"),
        ({"cx": 900}, "impossible cx"),
        ({"distortion": (-3, 0, 0, 0, 0)}, "impossible distortion.*one viewing direction"),
        ({"distortion": (0, 0)}, "impossible distortion"),
        ({"quat": (0, 0, 0, 0)}, "impossible quat"),
        ({"pos": ("a", 0, 0)}, "impossible pos"),
        ({"name": ""}, "impossible name"),
    ],
)
def test_what_no_camera_can_be_is_said_in_one_line(changes, said):
    with pytest.raises(UserError, match=said) as error:
        CAMERA.moved(**changes)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("format: vispeg-camera/2\n", "unknown format"),
        ("- 1\n", "not a camera file"),
        ("fl_x: 900.0\n", "not a camera file; expected 'format: vispeg-camera/1'"),
        (
            "cam0:\n  camera_model: pinhole\n  intrinsics: [9.0, 9.0, 4.0, 3.0]\n  resolution: [8, 6]\n",
            "Kalibr; .*vispeg-camera/1.*intrinsics are fx, fy, cx, cy",
        ),
        ("# Camera list\n1 OPENCV 1280 720 900.5 9e2 640 360 0.1 -0.2 0 0\n", "COLMAP; .*fx, fy, .*less 0.5"),
        ("3 SIMPLE_PINHOLE 8 6 9 4 3\n4 PINHOLE 8 6 9 9 4 3\n", "COLMAP; .*vispeg-camera/1"),
        ("a: [\n", "not YAML"),
        ("format: vispeg-camera/1\nname: a\nwidth: 64\n", "height: is missing"),
        ("format: vispeg-camera/1\nname: a\nwdith: 64\n", "did you mean 'width'"),
        ("format: vispeg-camera/1\ncameras: []\n", "not a list of cameras"),
        ("camera_matrix: {data: [1, 2]}\nimage_width: 4\nimage_height: 4\n", "not a camera matrix"),
        (
            "camera_matrix: {data: [60, 0, 32, 0, 60, 32, 0, 0, 1]}\ndistortion_model: equidistant\n"
            "image_width: 64\nimage_height: 64\n",
            "distortion_model: unknown lens.*got 'equidistant'",
        ),
        (
            "%YAML:1.0\n---\ncamera_matrix: {data: [60, 0, 32, 0, 60, 32, 0, 0, 1]}\nfisheye_model: 1\n"
            "distortion_coefficients: {data: [0.1, 0.02, 0, 0]}\nimage_width: 64\nimage_height: 64\n",
            "fisheye_model: unknown lens.*got 1",
        ),
        (
            "camera_matrix: {data: [60, 0, 32, 0, 60, 32, 0, 0, 1]}\ndistortion_model: plumb_bob\n"
            "distortion_coefficients: {data: [0.1, 0, 0, 0, 0, 0.02]}\nimage_width: 64\nimage_height: 64\n",
            r"distortion_coefficients: unknown lens.*\(plumb_bob\); got \[0.1, .*0.02\]",
        ),
    ],
)
def test_a_bad_file_is_named_with_its_key(tmp_path, text, said):
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(UserError, match=said) as error:
        load_cameras(path)
    assert str(path) in str(error.value)


def test_a_rational_lens_without_its_further_terms_is_browns_in_a_file_as_in_a_bag(tmp_path):
    text = "camera_matrix: {data: [60, 0, 32, 0, 60, 32, 0, 0, 1]}\nimage_width: 64\nimage_height: 64\n"
    text += "distortion_model: rational_polynomial\ndistortion_coefficients: {data: [0.1, 0.02, 0, 0, 0.01, 0, 0, 0]}\n"
    (tmp_path / "camera.yaml").write_text(text)
    assert load_camera(tmp_path / "camera.yaml").distortion == (0.1, 0.02, 0, 0, 0.01)


def test_a_missing_or_binary_file(tmp_path):
    with pytest.raises(UserError, match="no such file"):
        load_cameras(tmp_path / "none.yaml")
    (tmp_path / "raw.yaml").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(UserError, match="UTF-16 text; expected UTF-8"):
        load_cameras(tmp_path / "raw.yaml")


def test_a_complete_camera_lies_where_one_in_the_compiled_model_does_on_a_site_turned_by_angles():
    body = '<body><geom size=".1"/><site name="flange" pos=".1 .2 .3" euler="20 -40 70"/></body>'
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    plain = spec.copy()
    model_camera.add(plain, (CAMERA,))
    ours = plain.compile()
    model_camera.write(ours, 0, CAMERA)
    model_camera.add_complete(spec, (CAMERA,))
    theirs = spec.compile()
    np.testing.assert_allclose(theirs.cam_pos, ours.cam_pos, atol=1e-12)
    np.testing.assert_allclose(theirs.cam_quat, ours.cam_quat, atol=1e-12)
