"""Pictures of an AprilTag do for the camera's place what pictures of a board do."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from board_views import LENS, SIZE, X, Z, flange, pose
from scipy.spatial.transform import Rotation

from vispeg.api.calibrate import calibrate
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.render.calibration.board import Board
from vispeg.render.calibration.detect import find
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import save_cameras

SIDE, FINE = 0.06, 4  # m, and pixels drawn for one
TAG = Board("tag", 1, 1, SIDE, 0.0, "DICT_APRILTAG_36h11", tag=7)
MATRIX = np.array([[LENS.focal[0], 0, LENS.centre[0]], [0, LENS.focal[1], LENS.centre[1]], [0, 0, 1.0]])


def picture(at, number=7, words="DICT_APRILTAG_36h11", into=None):
    """A grey picture of a tag at camera_T_tag `at`, through a lens without distortion."""
    size, margin = 400, 60
    printed = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, words)), number, size)
    printed = cv2.copyMakeBorder(printed, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=255)
    to_tag = np.diag([SIDE / size, SIDE / size, 1.0]) @ np.array(
        [[1, 0, 0.5 - margin], [0, 1, 0.5 - margin], [0, 0, 1.0]]
    )
    fine = np.array([[FINE, 0, (FINE - 1) / 2], [0, FINE, (FINE - 1) / 2], [0, 0, 1.0]])
    whole = fine @ MATRIX @ np.column_stack([at[:3, 0], at[:3, 1], at[:3, 3]]) @ to_tag
    wide = (SIZE[0] * FINE, SIZE[1] * FINE)
    ground = np.full(wide[::-1], 180, np.uint8) if into is None else cv2.resize(into, wide)
    drawn = cv2.warpPerspective(
        printed, whole, wide, dst=ground, borderMode=cv2.BORDER_TRANSPARENT, flags=cv2.INTER_AREA
    )
    return cv2.resize(drawn, SIZE, interpolation=cv2.INTER_AREA)


def placed(rng, count):
    """camera_T_tag (n, 4, 4), tilted enough that no other pose looks alike."""
    out = []
    while len(out) < count:
        tilt = rng.uniform(25, 45, 2) * rng.choice([-1, 1], 2)
        at = pose([*tilt, rng.uniform(-60, 60)], [*rng.uniform([-0.05, -0.04], [0.05, 0.04]), rng.uniform(0.22, 0.3)])
        at[:3, 3] -= at[:3, :3] @ [SIDE / 2, SIDE / 2, 0]
        out.append(at)
    return np.stack(out)


def test_corners_are_where_the_pinhole_has_them():
    for at in placed(stream(1, "tag"), 5):
        view = find(picture(at), TAG)
        points = TAG.points @ at[:3, :3].T + at[:3, 3]
        pixels = (points @ MATRIX.T)[:, :2] / points[:, 2:]
        assert view is not None and np.abs(view.pixels - pixels).max() < 0.3


@pytest.fixture
def taken(tmp_path):
    """Makes a folder of pictures with poses beside it, and the lens's file."""
    lens = tmp_path / "lens.yaml"
    save_cameras(lens, Camera("k", *SIZE, *LENS.focal, *LENS.centre))

    def make(mount, count=10, draw=picture):
        folder, poses = tmp_path / mount, placed(stream(2, "taken", mount), count)
        folder.mkdir()
        rows = ["file,x,y,z,qw,qx,qy,qz"]
        for number, (at, arm) in enumerate(zip(poses, flange(poses, mount), strict=True)):
            cv2.imwrite(str(folder / f"{number}.png"), draw(at))
            quat = Rotation.from_matrix(arm[:3, :3]).as_quat(scalar_first=True)
            rows.append(",".join([f"{number}.png", *map(repr, map(float, (*arm[:3, 3], *quat)))]))
        (folder / "poses.csv").write_text("\n".join(rows) + "\n")
        return folder, {
            "board": "tag",
            "square": SIDE,
            "poses": folder / "poses.csv",
            "intrinsics": lens,
            "mount": mount,
        }

    return make


@pytest.mark.parametrize("mount", ["flange", "base"])
def test_a_tag_gives_the_cameras_place_back(mount, taken, tmp_path):
    folder, options = taken(mount)
    result = calibrate(folder, **options)
    eye = result.record["hand_eye"]
    error = np.abs(np.array(eye["pos_m"]) - X[:3, 3])
    assert error.max() < 2e-3 and np.all(error < np.maximum(2 * np.array(eye["half_width_95"]["pos_m"]), 1e-3))
    assert np.abs(np.array(eye["board"]["pos_m"]) - Z[:3, 3]).max() < 3e-3
    assert result.record["board"] == {"kind": "tag", "square_m": SIDE, "dictionary": TAG.dictionary, "tag": 7}
    result.save(tmp_path / "out")
    assert len(list((tmp_path / "out" / "corners").glob("*.png"))) == 10


def test_of_several_tags_one_is_named(taken):
    beside = pose([0, 0, 0], [0.22, -0.2, 0.6])
    folder, options = taken("flange", 6, lambda at: picture(beside, 3, into=picture(at)))
    with pytest.raises(UserError, match="several tags are in sight; choices: 3, 7"):
        calibrate(folder, **options)
    assert calibrate(folder, tag=7, **options).record["images"]["used"] == 6


def test_what_is_no_tag_is_one_line(taken):
    folder, options = taken("flange", 5, lambda at: picture(at, 2, "DICT_6X6_250"))
    with pytest.raises(
        UserError, match="no tag of DICT_APRILTAG_36h11 found in any of 5 images .there are 2 of DICT_6X6_250"
    ):
        calibrate(folder, **options)
    with pytest.raises(UserError, match="no such tag; expected 0 to 586"):
        calibrate(folder, tag=9999, **options)
    with pytest.raises(UserError, match="does not apply to a tag"):
        calibrate(folder, "9x6", **options)
    with pytest.raises(UserError, match="impossible size of a square"):
        calibrate(folder, **{**options, "square": 0.0})
    with pytest.raises(UserError, match="applies only to (--)?board tag"):
        calibrate(folder, "9x6", 0.02, tag=3)
