"""`vispeg camera`: from drawn images of a board to a camera file that says where the camera is."""

import json

import cv2
import numpy as np
import pytest
from board_views import BOARD, LENS, X, flange, picture, place
from scipy.spatial.transform import Rotation

from vispeg.core.seeds import stream
from vispeg.recordings.load import load
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import load_camera, load_posed, save_cameras
from vispeg.vision.eye import camera_of


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """Seven images of the board, the flange's poses beside them, exact."""
    folder, rng = tmp_path_factory.mktemp("images"), stream(1, "cli")
    poses = [place(rng) for _ in range(7)]
    rows = ["file,x,y,z,qw,qx,qy,qz"]
    for number, (at, arm) in enumerate(zip(poses, flange(poses), strict=True)):
        cv2.imwrite(str(folder / f"{number}.png"), picture(BOARD, at))
        quat = Rotation.from_matrix(arm[:3, :3]).as_quat(scalar_first=True)
        rows.append(",".join([f"{number}.png", *map(repr, map(float, (*arm[:3, 3], *quat)))]))
    (folder / "poses.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_calibrate_and_show(vispeg, images, tmp_path):
    args = ["--pattern", "9x6", "--square", 0.0236, "--distortion", "none", "--name", "wrist", "--out", "w"]
    code, out, err = vispeg("camera", "calibrate", images, "--poses", images / "poses.csv", *args)
    assert code == 0, err
    assert "x on flange" in out and "board origin scatter" in out and "6.png" in out
    results = json.loads((tmp_path / "w" / "results.json").read_text())
    assert results["format"] == "vispeg-calibration/1" and results["images"] == {"used": 7, "left_out": {}}
    eye = results["hand_eye"]
    assert np.all(np.abs(np.array(eye["pos_m"]) - X[:3, 3]) < np.maximum(eye["half_width_95"]["pos_m"], 5e-4))
    assert eye["board_scatter_mm"] < 0.5 and results["intrinsics"]["reprojection_px"] < 0.1
    assert abs(results["intrinsics"]["values"]["fx"] - LENS.focal[0]) < 2
    camera = load_camera(tmp_path / "w" / "camera.yaml")
    assert (camera.name, camera.parent, camera.width) == ("wrist", "flange", 640)
    assert np.allclose(camera.pos, eye["pos_m"]) and np.allclose(camera.rotation, X[:3, :3], atol=0.01)
    assert len(list((tmp_path / "w" / "corners").glob("*.png"))) == 7
    code, out, _ = vispeg("camera", "show", "w/camera.yaml")
    assert code == 0 and "wrist" in out and "640x480" in out and "flange" in out
    code, out, _ = vispeg("camera", "show", "w/camera.yaml", "--json")
    assert code == 0 and json.loads(out)["cameras"][0]["fx"] == camera.fx


@pytest.mark.parametrize("style", ["vispeg", "opencv", "ros"])
def test_show_states_no_pose_that_the_file_does_not(vispeg, tmp_path, style):
    """Also in JSON: the base's origin is a place like any other."""
    save_cameras(tmp_path / "k.yaml", Camera("k", 640, 480, *LENS.focal, *LENS.centre), style=style, posed=False)
    code, out, _ = vispeg("camera", "show", "k.yaml")
    assert code == 0 and "not stated" in out and "base" not in out and "+0.0000" not in out
    code, out, _ = vispeg("camera", "show", "k.yaml", "--json")
    (record,) = json.loads(out)["cameras"]
    assert record["fx"] == LENS.focal[0] and not {"parent", "pos", "quat"} & set(record)


def test_given_intrinsics_and_json(vispeg, images, tmp_path):
    save_cameras(tmp_path / "k.yaml", Camera("k", 640, 480, *LENS.focal, *LENS.centre))
    args = ["--pattern", "9x6", "--square", 0.0236, "--intrinsics", "k.yaml", "--out", "w", "--json"]
    code, out, _ = vispeg("camera", "calibrate", images, "--poses", images / "poses.csv", *args)
    results = json.loads(out)
    assert code == 0 and not results["intrinsics"]["fitted"] and "half_width_95" not in results["intrinsics"]
    assert np.abs(np.array(results["hand_eye"]["pos_m"]) - X[:3, 3]).max() < 1e-3


def test_without_poses_the_camera_s_file_states_none(vispeg, images):
    code, _, err = vispeg("camera", "calibrate", images, "--pattern", "9x6", "--square", 0.0236, "--out", "w")
    assert code == 0, err
    ((camera, posed),) = load_posed("w/camera.yaml")
    assert not posed and abs(camera.fx - LENS.focal[0]) < 2


def test_mistakes(refused, images, tmp_path):
    given = ["--square", "0.0236", "--out", "w"]
    refused(["camera", "calibrate", images, "--pattern", "9by6", *given], "COLUMNSxROWS")
    refused(["camera", "calibrate", images, *given], "--pattern: is required of a board, not of a tag")
    refused(["camera", "calibrate", images, "--pattern", "10x7", *given], "9x6 inner corners is there")
    refused(["camera", "calibrate", "gone", "--pattern", "9x6", *given], "gone: does not exist", "folder of images")
    refused(["camera", "calibrate", images, "--pattern", "9x6", "--poses", "gone.csv", *given], "no such file")
    refused(["camera", "calibrate", images, "--pattern", "9x6", "--intrinsics", "k.yaml", *given], "nothing to find")
    fixed = ["--pattern", "9x6", "--intrinsics", "k.yaml", "--poses", images / "poses.csv", "--distortion", "brown5"]
    refused(["camera", "calibrate", images, *fixed, *given], "--distortion without --intrinsics")
    for more in (["--marker", "0.018"], ["--dictionary", "DICT_4X4_50"], ["--legacy"]):
        refused(["camera", "calibrate", images, "--pattern", "9x6", *more, *given], more[0], "--board charuco")
    refused(["camera", "show", "gone.yaml"], "no such file")
    (tmp_path / "w").mkdir()
    (tmp_path / "w" / "mine").write_text("mine")
    refused(["camera", "calibrate", images, "--pattern", "9x6", *given], "not empty")


def test_a_recorded_look_at_a_board_calibrates_the_camera(vispeg, tmp_path):
    """A cell that states a board shows it; the joints say where the flange was; the hidden offset is in the place."""
    stated = "{kind: charuco, columns: 5, rows: 4, square: 0.03, marker: 0.022, dictionary: DICT_4X4_50}"
    model = f"format: vispeg-model/1\nrobot: iiwa14\ntool: meg50+peg16\ncell: {{world: nominal, board: {stated}}}\n"
    (tmp_path / "cell.yaml").write_text(model)
    how = ["--motion", "look", "--fps", 1, "--size", "640x480", "--seed", 5, "--out", "seen"]
    hidden = ["--effects", "camera_offset:wrist_wide:x=0.004"]
    code, _, err = vispeg("record", "cell.yaml", *how, *hidden)
    assert code == 0, err
    assert "charuco" in (tmp_path / "seen" / "recording.yaml").read_text()
    believed = camera_of(load(tmp_path / "seen").frames.cameras["wrist_wide"])
    save_cameras(tmp_path / "lens.yaml", believed)
    board = ["--board", "charuco", "--pattern", "5x4", "--square", 0.03, "--marker", 0.022]
    code, out, err = vispeg("camera", "calibrate", "seen", *board, "--intrinsics", "lens.yaml", "--out", "w", "--json")
    assert code == 0, err
    eye = json.loads(out)["hand_eye"]
    truth = np.array(believed.pos) + 0.004 * believed.rotation[:, 0]
    assert np.all(np.abs(np.array(eye["pos_m"]) - truth) < 1.5 * np.array(eye["half_width_95"]["pos_m"]))
    assert max(eye["half_width_95"]["pos_m"]) < 1e-3, "far less than the offset"
    code, _, err = vispeg("camera", "calibrate", "seen", *board, "--poses", "poses.csv", "--out", "v")
    assert code == 2 and "--poses: the poses of a recording follow from its joints" in err


def test_mirrored_pictures_are_refused(refused, images, tmp_path):
    """With fitted intrinsics too, which are those of the mirror image: the robot's motion tells."""
    (tmp_path / "mirrored").mkdir()
    for file in images.glob("*.png"):
        cv2.imwrite(str(tmp_path / "mirrored" / file.name), cv2.flip(cv2.imread(str(file)), 1))
    given = ["--pattern", "9x6", "--square", "0.0236", "--poses", images / "poses.csv", "--out", "w"]
    refused(["camera", "calibrate", "mirrored", *given], "the pictures are mirrored")
