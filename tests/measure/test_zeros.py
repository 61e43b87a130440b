"""Joint zeros and frames from static poses: found within their intervals, in any unit, and never invented."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vispeg.api.measure.zeros import measure_zeros
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.measure.pose_table import pose_columns
from vispeg.measure.screws import Screws
from vispeg.measure.zeros import Poses, half_width, solve
from vispeg.render.calibration.rigid import difference, from_quaternion, transform
from vispeg.robots.model import load
from vispeg.sim.compiled import flange_pose
from vispeg.worlds.model_file import load_model

MODEL = load("iiwa14")
ARM = Screws(lambda q: flange_pose(MODEL, q), 7)
BASE = transform(np.array([0.3, -0.5, 2.0]), np.array([1.0, 2.0, 0.5]))
TOOL = transform(np.array([0.5, 1.0, -0.2]), np.array([0.02, 0.05, 0.18]))
OFFSET = np.array([0.01, -0.02, 0.015, 0.005, -0.01, 0.02, -0.03])
NOISE = (3e-4, 1e-3)  # m, rad
ROWS = 30


def seen(rng, rows=ROWS, base=BASE, tool=TOOL, noise=NOISE, offset=OFFSET, still=()):
    """Angles as read, and tips as a tracker sees them."""
    q = rng.uniform(-1.4, 1.4, (rows, 7))
    q[:, list(still)] = 0.4
    tip = base @ ARM.poses(q - offset) @ tool
    turn = Rotation.from_matrix(tip[:, :3, :3]) * Rotation.from_rotvec(rng.normal(scale=noise[1], size=(rows, 3)))
    return q, tip[:, :3, 3] + rng.normal(scale=noise[0], size=(rows, 3)), turn


def alone(joint, offset):
    """The flange at zero, with the reading of one joint off."""
    return ARM.poses(-offset * np.eye(7)[[joint]])[0]


def test_the_product_of_exponentials_is_the_models_kinematics():
    q = stream(1, "screws").uniform(-3, 3, (50, 7))
    pose = flange_pose(MODEL, q)
    np.testing.assert_allclose(ARM.poses(q), from_quaternion(pose[:, :3], pose[:, 3:]), atol=1e-12)


@pytest.mark.parametrize("turned", [pytest.param(True, marks=pytest.mark.slow), False], ids=["poses", "positions"])
@pytest.mark.parametrize("known", ["", *(pytest.param(frame, marks=pytest.mark.slow) for frame in ("base", "tool"))])
def test_intervals_hold_zeros_and_frames_as_often_as_they_say(turned, known):
    """95 % of a hundred draws, of each offset that can be told, and of both frames for zeros that are left at 0."""
    base, tool = np.eye(4) if known == "base" else BASE, np.eye(4) if known == "tool" else TOOL
    hits, frames = [], []
    for seed in range(100):
        q, position, turn = seen(stream(seed, "zeros", known), base=base, tool=tool)
        poses = Poses(q, position, turn.as_matrix() if turned else None)
        found = solve(poses, ARM, base_known=known == "base", tool_known=known == "tool")
        told = found.u["offset"] > 0
        hits.append((np.abs(found.offset - OFFSET) < half_width(found.u["offset"], found.dof))[told])
        if not turned:
            continue
        left = np.where(told, 0.0, OFFSET)  # what an untold zero turns goes into the frame beside it
        for name, truth, pose in (
            (
                "base",
                base @ ARM.poses(np.zeros((1, 7)) - left * (np.arange(7) == 0))[0] @ np.linalg.inv(ARM.home),
                found.base,
            ),
            (
                "tool",
                np.linalg.inv(ARM.home) @ ARM.poses(np.zeros((1, 7)) - left * (np.arange(7) == 6))[0] @ tool,
                found.tool,
            ),
        ):
            if name != known:
                frames.append(np.abs(difference(pose, truth)) < half_width(found.u[name], found.dof))
    untold = {"": 2, "base": 1, "tool": 1}[known]
    if known == "tool" and not turned:
        untold = 2  # the flange's own point lies on the last axis
    assert np.array(hits).shape == (100, 7 - untold)
    assert 0.925 < np.mean(hits) < 0.975
    assert not turned or 0.925 < np.mean(frames) < 0.975


def test_what_cannot_be_told_is_named_with_what_does_as_well():
    q, position, turn = seen(stream(3, "untold"))
    both = solve(Poses(q, position, turn.as_matrix()), ARM).confounded
    assert [(c.joint, c.base, c.tool, c.others) for c in both] == [(0, True, False, ()), (6, False, True, ())]
    q, position, _ = seen(stream(3, "untold"), tool=transform(np.zeros(3), np.array([0, 0, 0.2])))
    held = solve(Poses(q, position), ARM).confounded
    assert 6 in [c.joint for c in held]
    q, position, turn = seen(stream(3, "still"), still=(2,))  # a joint that stands turns nothing by itself
    found = solve(Poses(q, position, turn.as_matrix()), ARM)
    assert len(found.confounded) == 3 or found.u["offset"][2] > 0


def table(file, names, *columns):
    np.savetxt(file, np.concatenate(columns, axis=1), delimiter=",", header=",".join(names), comments="")
    return file


WHOLE = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
Q = [f"q{k + 1}" for k in range(7)]
FORMS = {
    "UR's, mm and degrees": lambda q, p, t: (
        [*Q, "x", "y", "z", "rx", "ry", "rz"], np.degrees(q), 1e3 * p, t.as_rotvec(),
    ),
    "a rotation vector in degrees": lambda q, p, t: (
        [*Q, "x_m", "y_m", "z_m", "rx", "ry", "rz"], q, p, t.as_rotvec(degrees=True),
    ),
    "quaternion last": lambda q, p, t: (
        [*(f"joint{k + 1}" for k in range(7)), "px", "py", "pz", "qx", "qy", "qz", "qw"], q, p, t.as_quat(),
    ),
    "ROS": lambda q, p, t: (
        [*(f"position.joint{k + 1}" for k in range(7)), *(f"pose.position.{a}" for a in "xyz"),
         *(f"pose.orientation.{a}" for a in "xyzw")], q, p, t.as_quat(),
    ),
    "roll pitch yaw": lambda q, p, t: (
        [*(f"joint{k + 1} [deg]" for k in range(7)), "X [mm]", "Y [mm]", "Z [mm]", "roll", "pitch", "yaw"],
        np.degrees(q), 1e3 * p, t.as_euler("xyz", degrees=True),
    ),
    "moving axes": lambda q, p, t: (
        [*Q, "tip_x_mm", "tip_y_mm", "tip_z_mm", "rx_rad", "ry_rad", "rz_rad"], q, 1e3 * p, t.as_euler("XYZ"),
    ),
    "two units": lambda q, p, t: (
        ["q1 [deg]", *(f"q{k} [rad]" for k in range(2, 8)), "x_mm", "y_mm", "z_mm"],
        q * [180 / np.pi, *np.ones(6)], 1e3 * p,
    ),
    "a unit of one joint": lambda q, p, t: (
        ["q1 [rad]", *Q[1:], "x_mm", "y_mm", "z_mm"], q * [1.0, *np.full(6, 180 / np.pi)], 1e3 * p,
    ),
    "positions, cm": lambda q, p, t: ([*Q, "marker_x", "marker_y", "marker_z"], q, 1e2 * p),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_tables_as_people_have_them(form, tmp_path):
    names, *columns = FORMS[form](*seen(stream(7, "forms"), noise=(1e-6, 1e-6)))
    result = measure_zeros(table(tmp_path / "poses.csv", names, *columns), tmp_path / "zeros.yaml", "iiwa14")
    for joint, offset in list(zip(MODEL.joints, OFFSET, strict=True))[1:6]:
        assert result.measurement.result(f"offset_{joint}").value == pytest.approx(offset, abs=1e-5), joint
    assert result.measurement.result("base_x").value == pytest.approx(1.0, abs=1e-4)
    effects = {e.where: e.params["offset"].value for e in result.measurement.effects}
    assert set(effects) == set(MODEL.joints[1:6])
    said = " ".join(result.measurement.notes)
    assert "joint1: its zero cannot be distinguished from the base's frame" in said
    assert "joint7: its zero cannot be distinguished from the tool's frame" in said


def test_the_effects_go_into_a_model(tmp_path):
    from vispeg.api.add import add

    names, *columns = FORMS["quaternion last"](*seen(stream(7, "forms")))
    measure_zeros(table(tmp_path / "poses.csv", names, *columns), tmp_path / "zeros.yaml", "iiwa14", base="unknown")
    add("iiwa14", str(tmp_path / "zeros.yaml"), out=tmp_path / "model.yaml")
    loaded = load_model(tmp_path / "model.yaml")
    assert [e.where for e in loaded.effects] == list(MODEL.joints[1:6])


@pytest.mark.parametrize("above", ["", "# a robot\n# its poses\n"])
def test_a_row_that_was_moved_is_named(tmp_path, above):
    q, position, turn = seen(stream(9, "odd"))
    position[11] += [0.01, 0, 0]
    file = table(
        tmp_path / "poses.csv",
        [*Q, *WHOLE],
        q,
        position,
        turn.as_quat(scalar_first=True),
    )
    file.write_text(above + file.read_text())
    notes = measure_zeros(file, tmp_path / "zeros.yaml", "iiwa14").measurement.notes
    assert [note for note in notes if f"row {13 + above.count('#')} of poses.csv" in note]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t[:3], "too few poses; expected"),
        (lambda t: [line.rpartition(",")[0] for line in t], "not one orientation"),
        (lambda t: [line.split(",", 1)[1] for line in t], "no angles of joint1"),
        (lambda t: [t[0], *(line.replace(line.split(",")[8], "", 1) for line in t[1:])], "a reading is missing"),
        (lambda t: [t[0], *(line + "1" for line in t[1:])], "not a unit quaternion|fits in two ways"),
        (lambda t: [t[0].replace("x_m", "p").replace("y_m", "r"), *t[1:]], "no measured position"),
        (lambda t: [t[0].replace("qz", "qx"), *t[1:]], "qx"),
    ],
    ids=["few", "part", "joint", "empty", "quaternion", "position", "twice"],
)
def test_tables_that_are_none_are_one_line(change, words, tmp_path):
    q, position, turn = seen(stream(2, "bad"))
    file = table(tmp_path / "poses.csv", [*(f"joint{k + 1}" for k in range(7)), *WHOLE],
                 q, position, turn.as_quat(scalar_first=True))  # fmt: skip
    file.write_text("\n".join(change(file.read_text().split("\n")[:-1])) + "\n")
    with pytest.raises(UserError, match=words):
        measure_zeros(file, tmp_path / "zeros.yaml", "iiwa14")
    assert not (tmp_path / "zeros.yaml").exists()


def test_angles_that_mean_two_things_alike_are_asked_for(tmp_path):
    """Poses that all turn about one axis: a rotation vector and turns about axes are the same numbers."""
    rng = stream(5, "open")
    q = np.zeros((20, 7))
    q[:, [0, 6]] = rng.uniform(-1.2, 1.2, (20, 2))
    tip = ARM.poses(q)
    turn = Rotation.from_matrix(tip[:, :3, :3])
    file = table(
        tmp_path / "poses.csv", [*Q, "x_m", "y_m", "z_m", "rx", "ry", "rz"], q, tip[:, :3, 3], turn.as_rotvec()
    )
    with pytest.raises(UserError, match="fits in two ways; expected units in the header.*orientation"):
        measure_zeros(file, tmp_path / "zeros.yaml", "iiwa14")


@pytest.mark.parametrize(
    ("form", "stated", "words"),
    [
        ("UR's, mm and degrees", "quaternion", "orientation: .*choices: rotation_vector, fixed_xyz, moving_xyz"),
        ("quaternion last", "rotation_vector", "orientation: no angles whose meaning could be stated"),
        ("positions, cm", "rotation_vector", "orientation: no angles whose meaning could be stated"),
    ],
)
def test_a_stated_orientation_that_is_none_or_has_no_use_is_refused(form, stated, words, tmp_path):
    names, *columns = FORMS[form](*seen(stream(7, "forms")))
    with pytest.raises(UserError, match=words):
        measure_zeros(
            table(tmp_path / "poses.csv", names, *columns), tmp_path / "zeros.yaml", "iiwa14", orientation=stated
        )


def test_a_header_with_two_poses_is_refused(tmp_path):
    with pytest.raises(UserError, match="two columns of one name"):
        pose_columns(["tip_x", "tip_y", "tip_z", "cmd_x"], tmp_path)
