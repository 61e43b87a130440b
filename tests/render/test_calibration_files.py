"""Flange poses and known intrinsics are read as their formats say, and a wrong file is said in a line."""

from pathlib import Path

import numpy as np
import pytest
from board_views import LENS, X, Z
from scipy.spatial.transform import Rotation

from vispeg.api.photographs import photographs
from vispeg.core.errors import UserError
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.recording import Control, Recording, in_order
from vispeg.recordings.write import write
from vispeg.render.calibration import read_poses
from vispeg.render.calibration.known import read_intrinsics
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import load_cameras, save_cameras
from vispeg.robots.model import load as robot
from vispeg.sim.compiled import flange_pose

HEAD = "file,x,y,z,qw,qx,qy,qz\n"
SIZE = "<image_width>640</image_width><image_height>480</image_height>"
VISP = "<root><!-- <px>1</px> --><camera>" + SIZE + "<model>{}</model></camera></root>"


def _row(name, pose):
    quat = Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True)
    return ",".join([name, *(repr(float(v)) for v in (*pose[:3, 3], *quat))]) + "\n"


def test_csv_in_any_order(tmp_path):
    file = tmp_path / "poses.csv"
    file.write_text(HEAD + _row("b.png", Z) + _row("a.png", X) + _row("unused.png", X))
    assert np.allclose(read_poses(file, ["a.png", "b.png"]), [X, Z], atol=1e-12)


def test_visp_joins_the_last_number(tmp_path):
    for number, pose in ((2, X), (12, Z)):
        values = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_rotvec()]
        data = "".join(f"  - [{float(v)!r}]\n" for v in values)
        (tmp_path / f"pose_rPe_{number}.yaml").write_text(f"rows: 6\ncols: 1\ndata:\n{data}")
    assert np.allclose(read_poses(tmp_path, ["image-12.png", "image-2.png"]), [Z, X], atol=1e-12)
    with pytest.raises(UserError, match="no pose for the image 'image-3.png'"):
        read_poses(tmp_path, ["image-3.png"])
    (tmp_path / "again_2.yaml").write_text("data: []")
    with pytest.raises(UserError, match="several poses"):
        read_poses(tmp_path, ["image-2.png"])
    (tmp_path / "pose_4.yaml").write_text("data: [[1], [2]]")
    with pytest.raises(UserError, match="6 finite numbers"):
        read_poses(tmp_path, ["4.png"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD + _row("b.png", X), "no pose for the image.*a.png"),
        (HEAD + _row("a.png", X) * 2, "two poses"),
        (HEAD + "a.png,0,0,0,1,1,0,0\n", "line 2.*unit quaternion"),
        (HEAD + "\nb.png,0,0,0,1,0,0,0\n\na.png,0,0,0,1,1,0,0\n", "line 5.*unit quaternion"),
        (HEAD + "a.png,335,32,308,1,0,0,0\n", "expected metres"),
        (HEAD + "a.png,0,0,nan,1,0,0,0\n", "7 finite numbers"),
        (HEAD + "a.png,0,0,0,1,0\n", "not a pose"),
        ("file,x,y,z,qx,qy,qz\na.png,0,0,0,0,0,0\n", "no column qw"),
        ("", "is empty"),
        (HEAD, "no column file"),
    ],
)
def test_wrong_tables(tmp_path, text, words):
    file = tmp_path / "poses.csv"
    file.write_text(text)
    with pytest.raises(UserError, match=words):
        read_poses(file, ["a.png"])


@pytest.mark.parametrize("style", ["vispeg", "opencv", "ros"])
@pytest.mark.parametrize("name", ['a"b', "a\\q", "left: 1"])
def test_any_name_of_a_camera_comes_back(tmp_path, style, name):
    camera = Camera(name, 64, 48, 50.0, 50.0, 31.5, 23.5)
    assert load_cameras(save_cameras(tmp_path / "eye.yaml", camera, style=style))[0].name == name


def test_known_intrinsics(tmp_path):
    camera = Camera("eye", 640, 480, *LENS.focal, *LENS.centre, LENS.distortion)
    for style in ("vispeg", "opencv", "ros"):
        read = read_intrinsics(save_cameras(tmp_path / f"{style}.yaml", camera, style=style))
        assert read == LENS
    visp = tmp_path / "visp.xml"
    visp.write_text(VISP.format("<px>600</px><py>602</py><u0>322</u0><v0>243</v0><kud>-0</kud><kdu>0</kdu>"))
    assert read_intrinsics(visp).values.tolist() == [600, 602, 322, 243, 0, 0, 0, 0, 0]
    visp.write_text(VISP.format("<px>600</px><py>602</py><u0>322</u0><v0>243</v0><kud>-0.1</kud>"))
    with pytest.raises(UserError, match="not Brown's"):
        read_intrinsics(visp)
    visp.write_text(VISP.format("<px>600</px>"))
    with pytest.raises(UserError, match="py"):
        read_intrinsics(visp)
    with pytest.raises(UserError, match="no such file"):
        read_intrinsics(tmp_path / "gone.xml")


def test_the_flange_of_a_recording_s_pictures_does_not_depend_on_the_order_of_its_joints(tmp_path):
    """The joints of an iiwa as the model lists them, in reverse, and without the last one, which stands at 0."""
    arm, time = robot("iiwa14"), np.arange(100) / 100.0
    q = np.linspace(0.7, 0.1, 7) * np.sin(time)[:, None] + 0.2
    q[:, 6] = 0.0
    eye = RecordedCamera("eye", 8, 6, 9.0, 9.0, 3.5, 2.5)
    rows, picture = [10, 50, 90], np.zeros((6, 8, 3), np.uint8)
    frames = Frames({"eye": eye}, tuple(RecordedFrame(float(time[row]), eye, picture) for row in rows))
    wanted = flange_pose(arm, q[rows])
    for name, joints in (("all", arm.joints), ("reversed", arm.joints[::-1]), ("six", arm.joints[:6])):
        n = len(joints)
        rec = Recording(Path("r"), "iiwa14", arm.joints[:n], 100.0, Control(), time, q[:, :n], frames=frames)
        found = photographs(write(in_order(rec, joints), tmp_path / name), None, "eye")
        assert found.flange([file.name for file in found.files])[:, :3, 3] == pytest.approx(wanted[:, :3], abs=1e-6)


def test_pictures_of_one_name_in_two_folders_are_refused_as_their_poses_are_looked_up_by_name(tmp_path):
    time, eye = np.arange(100) / 100.0, RecordedCamera("eye", 8, 6, 9.0, 9.0, 3.5, 2.5)
    frames = Frames({"eye": eye}, tuple(RecordedFrame(t, eye, np.zeros((6, 8, 3), np.uint8)) for t in (0.1, 0.5)))
    q = np.tile(np.linspace(0.7, 0.1, 7), (100, 1))
    out = write(
        Recording(Path("r"), "iiwa14", robot("iiwa14").joints, 100.0, Control(), time, q, frames=frames), tmp_path / "r"
    )
    index = out / "frames" / "index.csv"
    text = index.read_text()
    for number, file in enumerate(sorted((out / "frames").glob("**/*.png"))):
        there = out / "frames" / f"set{number}" / "image.png"
        there.parent.mkdir()
        text = text.replace(file.relative_to(out / "frames").as_posix(), f"set{number}/image.png")
        file.rename(there)
    index.write_text(text)
    with pytest.raises(UserError, match="frames/index.csv: two pictures have one file name"):
        photographs(out, None, "eye")
