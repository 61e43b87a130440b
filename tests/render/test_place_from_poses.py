"""A camera's place from transforms: the flange's or the joints', and a tag's in the camera."""

from __future__ import annotations

import numpy as np
import pytest
from board_views import X, Z, pose
from scipy.spatial.transform import Rotation

from vispeg.api.camera_place import place_camera
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.measure.pose_table import motions, pose_columns, poses_of
from vispeg.recordings.tables.read import read_table
from vispeg.render.calibration.from_poses import place
from vispeg.render.calibration.rigid import from_quaternion, inverse, shifted
from vispeg.robots.model import load
from vispeg.sim.compiled import flange_pose

MODEL = load("iiwa14")


def off(found, truth=X):
    """(m on the mount's axes, rad about the camera's), shape (6,)."""
    turn = Rotation.from_matrix(truth[:3, :3].T @ found[:3, :3]).as_rotvec()
    return np.concatenate([found[:3, 3] - truth[:3, 3], turn])


def seen(rng, count, mount, noise=(1e-3, 3e-3)):
    """Joint angles, base_T_flange, and camera_T_tag with noise (m, rad an axis)."""
    q = rng.uniform(-0.8, 0.8, (count, 7)) + [0, 0.5, 0, -1.2, 0, 0.8, 0]
    at = flange_pose(MODEL, q)
    flange = from_quaternion(at[:, :3], at[:, 3:])
    tags = inverse(X) @ (inverse(flange) if mount == "flange" else flange) @ Z
    by = np.concatenate([rng.normal(scale=s, size=(count, 3)) for s in noise], axis=1)
    return q, flange, shifted(tags, by)


@pytest.mark.parametrize("mount", ["flange", "base"])
def test_exact_transforms_give_the_camera_back(mount):
    _, flange, tags = seen(stream(1, "exact"), 8, mount, (0.0, 0.0))
    found = place(tags, flange, mount)
    assert np.abs(off(found.found.camera)).max() < 1e-6 and np.abs(off(found.found.board, Z)).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("mount", ["flange", "base"])
def test_intervals_hold_the_truth(mount):
    inside = []
    for seed in range(30):
        _, flange, tags = seen(stream(seed, "place", mount), 15, mount)
        found = place(tags, flange, mount)
        inside.append(np.abs(off(found.found.camera)) < found.half)
        assert found.half[:3].max() < 5e-3
    assert 0.9 <= np.mean(inside) <= 1.0


def test_one_bad_pose_moves_little_and_is_named(tmp_path):
    rng = stream(4, "bad")
    q, _, tags = seen(rng, 16, "flange", (3e-4, 1e-3))
    tags[5] = tags[5] @ pose([0, 0, 20], [0.05, 0, 0])
    result = place_camera(joints_table(tmp_path, q, tags), robot="iiwa14")
    eye = result.record["hand_eye"]
    assert np.linalg.norm(np.array(eye["pos_m"]) - X[:3, 3]) < 3e-3
    assert any("row 7 of tags.csv" in note for note in result.record["notes"])
    text = (tmp_path / "tags.csv").read_text()
    (tmp_path / "tags.csv").write_text(f"# by a detector\n# of today\n{text}")
    record = place_camera(tmp_path / "tags.csv", robot="iiwa14").record
    (worst,) = (row["row"] for row in record["rows"] if row["misfit"] > 3)
    assert worst == 9 and any("row 9 of tags.csv" in note for note in record["notes"])


def test_the_motions_of_flange_and_tag_are_the_same():
    for mount in ("flange", "base"):
        _, flange, tags = seen(stream(2, "motion"), 9, mount, (0.0, 0.0))
        np.testing.assert_allclose(np.abs(motions(flange)), np.abs(motions(tags)), atol=1e-6)


def write(file, names, *columns):
    np.savetxt(file, np.concatenate(columns, axis=1), delimiter=",", header=",".join(names), comments="")
    return file


def joints_table(tmp_path, q, tags):
    quat = Rotation.from_matrix(tags[:, :3, :3]).as_quat()
    names = [*(f"q{k + 1}" for k in range(7)), *(f"tag_{a}" for a in ("x", "y", "z", "qx", "qy", "qz", "qw"))]
    return write(tmp_path / "tags.csv", names, q, tags[:, :3, 3], quat)


def forms(flange, tags):
    turns = [Rotation.from_matrix(poses[:, :3, :3]) for poses in (flange, tags)]
    at = [poses[:, :3, 3] for poses in (flange, tags)]

    def names(who, last):
        return [f"{who}{a}" for a in ("x", "y", "z", *last)]

    quat, three = ("qw", "qx", "qy", "qz"), ("rx", "ry", "rz")
    return {
        "quaternions": (
            names("flange_", quat) + names("tag_", quat),
            at[0], turns[0].as_quat(scalar_first=True), at[1], turns[1].as_quat(scalar_first=True),
        ),
        "UR in mm and OpenCV": (
            names("tcp_", three) + names("camera_T_marker_", three),
            1e3 * at[0], turns[0].as_rotvec(), at[1], turns[1].as_rotvec(),
        ),
        "angles in degrees": (
            names("gripper ", ("roll", "pitch", "yaw")) + names("april_", quat),
            at[0], turns[0].as_euler("xyz", degrees=True), 1e3 * at[1], turns[1].as_quat(scalar_first=True),
        ),
        "ROS": (
            [f"robot.pose.position.{a}" for a in "xyz"] + [f"robot.pose.orientation.{a}" for a in "xyzw"]
            + [f"tag.pose.position.{a}" for a in "xyz"] + [f"tag.pose.orientation.{a}" for a in "xyzw"],
            at[0], turns[0].as_quat(), at[1], turns[1].as_quat(),
        ),
    }  # fmt: skip


@pytest.mark.parametrize("mount", ["flange", "base"])
@pytest.mark.parametrize("form", ["quaternions", "UR in mm and OpenCV", "angles in degrees", "ROS"])
def test_tables_as_people_have_them(form, mount, tmp_path):
    _, flange, tags = seen(stream(3, "forms"), 12, mount, (1e-6, 1e-6))
    names, *columns = forms(flange, tags)[form]
    result = place_camera(write(tmp_path / "tags.csv", names, *columns), mount=mount)
    eye = result.record["hand_eye"]
    assert eye["parent"] == mount
    np.testing.assert_allclose(eye["pos_m"], X[:3, 3], atol=2e-5)


@pytest.mark.parametrize(("unit", "assumed"), [("", ["m", "cm", "mm"]), ("_cm", [""])])
def test_an_interpretation_tells_the_unit_that_it_assumes(tmp_path, unit, assumed):
    """Centimetres that the header does not state are a last resort; those that it states are none."""
    names = [*(f"x{unit} y{unit} z{unit}".split()), "rx_deg", "ry_deg", "rz_deg"]
    table = read_table(write(tmp_path / "tags.csv", names, np.ones((3, 6))))
    ways = poses_of(table, pose_columns(names, table.file), "fixed_xyz")
    assert [way.assumed_unit for way in ways] == assumed


def test_what_is_no_hand_eye_table_is_one_line(tmp_path):
    q, flange, tags = seen(stream(8, "wrong"), 10, "flange", (1e-5, 1e-5))
    names, *columns = forms(flange, tags)["quaternions"]
    file = write(tmp_path / "tags.csv", names, *columns)
    with pytest.raises(UserError, match="the other way round.*mount"):
        place_camera(file, mount="base")
    with pytest.raises(UserError, match="too few poses"):
        place_camera(write(tmp_path / "few.csv", names, *(c[:3] for c in columns)))
    with pytest.raises(UserError, match="not the robot's pose and a tag's"):
        place_camera(write(tmp_path / "one.csv", names[7:], *columns[2:]))
    with pytest.raises(UserError, match="a pose without orientation"):
        place_camera(write(tmp_path / "bare.csv", names[:10], *columns[:3]))
    one_axis = np.tile(np.eye(4), (10, 1, 1))
    one_axis[:, :3, :3] = Rotation.from_rotvec(np.linspace(0, 1, 10)[:, None] * [0, 0, 1.0]).as_matrix()
    one_axis[:, :3, 3] = [0.4, 0.1, 0.3]
    seen_so = inverse(X) @ inverse(one_axis) @ Z
    names, *columns = forms(one_axis, seen_so)["quaternions"]
    names = [f"{name}_m" if name[-1] in "xyz" and name[-2] == "_" else name for name in names]
    with pytest.raises(UserError, match="turned about one axis only"):
        place_camera(write(tmp_path / "turned.csv", names, *columns))
