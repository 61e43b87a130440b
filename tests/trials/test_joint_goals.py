"""A flange pose held by joint angles: the law in free air, targets reached, joints and speeds respected; wiring."""

import numpy as np
import pytest

from vispeg.control.laws import rotation_vector, turned
from vispeg.core.errors import UserError
from vispeg.task.environments.vector import world_of
from vispeg.task.interface import interface_in
from vispeg.trials.joint_goals import LEVER, MARGIN, JointGoals
from vispeg.trials.lerobot import MotorPart, Motors, Slope, Wiring, read_wiring

DT = 0.005


@pytest.fixture(scope="module")
def interface():
    """What a policy of the task with an iiwa 14 means."""
    _, config, file = world_of("nominal", {})
    return interface_in(config, file, "state", modality="state")


def home(interface):
    return np.array(interface.arm.home_rad)


def off(pose, other):
    """Metres and radians between two flange poses."""
    turn = rotation_vector(pose[None, 3:], other[None, 3:])
    return np.linalg.norm(pose[:3] - other[:3]), np.linalg.norm(turn)


def moved(pose, metres, radians):
    return np.concatenate([pose[:3] + metres, turned(pose[None, 3:], np.array([radians]))[0]])


def test_it_reaches_poses_all_around(interface):
    """Within 20 um and 50 urad after two seconds, from wherever the last one left it."""
    rng, begin = np.random.default_rng(0), interface.flange(home(interface))
    goals = JointGoals(interface, home(interface))
    for _ in range(12):
        pose = moved(begin, rng.uniform(-0.1, 0.1, 3), rng.uniform(-0.3, 0.3, 3))
        for _ in range(400):
            q = goals.towards(pose, DT)
        metres, radians = off(interface.flange(q), pose)
        assert metres < 2e-5 and radians < 5e-5
        assert (q > np.array(interface.arm.low_rad)).all() and (q < np.array(interface.arm.high_rad)).all()


def test_in_free_air_it_moves_as_the_policys_controller_would(interface):
    """A step of a critically damped spring, `1 - (1 + w t) exp(-w t)`, at both its time and another rate's."""
    w, q0 = np.sqrt(interface.controller.kp[0]), home(interface)
    begin = interface.flange(q0)
    pose = moved(begin, [0.01, -0.004, 0.006], [0, 0, 0])
    for dt, within in ((0.001, 0.01), (DT, 0.03)):
        goals, t = JointGoals(interface, q0), dt * np.arange(1, round(0.4 / dt) + 1)
        share = [(interface.flange(goals.towards(pose, dt))[:3] - begin[:3]) / (pose - begin)[:3] for _ in t]
        law = 1 - (1 + w * t) * np.exp(-w * t)
        np.testing.assert_allclose(np.array(share), np.tile(law[:, None], 3), atol=within)


def test_joints_go_no_faster_and_no_farther_than_they_can(interface):
    """A far target, a slow joint, and one that stands at its limit: the others do its part."""
    q0 = home(interface)
    slow = interface.model_copy(update={"arm": interface.arm.model_copy(update={"velocity_limit": (0.1,) * 7})})
    goals, before = JointGoals(slow, q0), q0
    for _ in range(300):
        q = goals.towards(moved(interface.flange(q0), [0.1, 0.2, 0.1], [0, 0, 0.5]), DT)
        assert np.abs(q - before).max() <= 0.1 * DT * (1 + 1e-9)
        before = q
    for joint, left in ((1, 1e-4), (3, 0.03)):  # without its elbow it comes no farther, and no worse
        high = list(interface.arm.high_rad)
        high[joint] = q0[joint] + MARGIN + 1e-3
        tight = interface.model_copy(update={"arm": interface.arm.model_copy(update={"high_rad": tuple(high)})})
        pose = moved(interface.flange(q0), [0.03, 0.0, 0.0], [0, 0, 0])
        goals, free = JointGoals(tight, q0), JointGoals(interface, q0)
        for _ in range(600):
            q, other = goals.towards(pose, DT), free.towards(pose, DT)
            assert q[joint] <= high[joint] - MARGIN + 1e-12
        assert other[joint] > high[joint], "the limit is in the way"
        metres, radians = off(interface.flange(q), pose)
        assert np.hypot(metres, LEVER * radians) < left


@pytest.mark.slow
def test_beyond_its_reach_it_stays_finite_and_comes_back(interface):
    q0 = home(interface)
    goals, far = JointGoals(interface, q0), moved(interface.flange(q0), [1.5, 0, 0.5], [0, 0, 0])
    for _ in range(1000):
        before, q = goals.q, goals.towards(far, DT)
        assert (
            np.isfinite(q).all() and (np.abs(q - before) <= np.array(interface.arm.velocity_limit) * DT + 1e-12).all()
        )
    for _ in range(3000):
        q = goals.towards(interface.flange(q0), DT)
    metres, radians = off(interface.flange(q), interface.flange(q0))
    assert metres < 1e-4 and radians < 1e-3


def test_the_slope_of_readings_is_their_velocity_to_what_steps_of_an_encoder_leave():
    rng, step = np.random.default_rng(1), np.radians(360 / 4096)
    t = np.cumsum(rng.uniform(0.004, 0.006, 400))
    slope = Slope(0.06)
    exact = [slope.add(x, np.array([0.3 * x, -0.1 * x + 1])) for x in t][-1]
    np.testing.assert_allclose(exact, [0.3, -0.1], atol=1e-9)
    slope = Slope(0.06)
    seen = np.array([slope.add(x, step * np.round((0.3 + 0.2 * x) * np.ones(1) / step)) for x in t])[20:]
    spread = step / np.sqrt(12) * np.sqrt(12 / 12) / 0.06
    assert np.abs(seen.mean() - 0.2) < 0.002 and seen.std() < 1.5 * spread
    assert Slope(0.06).add(0.0, np.ones(2)).tolist() == [0, 0]


def test_readings_further_apart_than_the_window_have_a_slope_too():
    slope = Slope(0.06)
    seen = [slope.add(0.1 * k, np.array([0.2 * k])) for k in range(5)]  # 10 Hz, 2 rad/s
    np.testing.assert_allclose(seen[1:], np.full((4, 1), 2.0), atol=1e-9)


JOINTS = ("a", "b", "c")
STATE = ["grip.pos", "b.pos", "left.pos", "c.pos", "temperature"]
WIRING = Wiring(
    joints={
        "a": MotorPart(motor="left", sign=-1, zero_rad=0.5),
        "b": MotorPart(unit="percent", range_rad=(1.0, -2.0)),
        "c": MotorPart(unit="rad"),
    }
)


def test_units_signs_and_order_go_round():
    motors = Motors(WIRING, JOINTS, STATE, ["c.pos", "grip.pos", "left.pos", "b.pos"], None)
    state = np.array([30.0, -100.0, 90.0, 0.25, 41.0])
    q = motors.angles(state)
    np.testing.assert_allclose(q, [0.5 - np.pi / 2, 1.0, 0.25])
    np.testing.assert_allclose(motors.action(q, state), [0.25, 30.0, 90.0, -100.0])
    np.testing.assert_allclose(motors.action(np.array([0.5, -0.5, 0.0]), state), [0, 30, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("wiring", "state", "named"),
    [
        (Wiring(joints={"d": MotorPart()}), STATE, "joints.d: no joint of the arm; expected a, b, c"),
        (Wiring(), STATE, "no such motor for a; expected one of grip, b, left, c; joints.a.motor of a FILE.yaml"),
        (Wiring(joints={"a": MotorPart(motor="b")}), STATE, "two joints name the same motor; got 'b'"),
    ],
)
def test_motors_that_are_not_there_are_named(wiring, state, named):
    with pytest.raises(UserError, match=named):
        Motors(wiring, JOINTS, state, state, None)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("joint: {}", "joint: unknown key"),
        ("joints: {a: {unit: degrees}}", "joints.a.unit: is not one of the choices"),
        ("joints: {a: {unit: percent}}", "must be given together"),
        ("joints: {a: {unit: percent, range_rad: [0, 1], sign: -1}}", "range_rad determines sign and zero_rad"),
        ("joints: {a: {unit: percent, range_rad: [1, 1]}}", "zero width"),
        ("joints: {a: {sign: 2}}", "joints.a.sign"),
        ("cameras: {wrist: {fx: 10}}", "fx, fy, cx, cy must be given together"),
        ("rate_hz: 5", "rate_hz"),
        ("- joints", "a mapping"),
    ],
)
def test_a_bad_file_is_one_line(tmp_path, text, named):
    (tmp_path / "w.yaml").write_text(text)
    with pytest.raises(UserError, match=named) as said:
        read_wiring(tmp_path / "w.yaml")
    assert "w.yaml" in str(said.value) and "\n" not in str(said.value)
