"""Motions: inside the limits, exact derivatives, at rest at the start, the same for the same seed."""

from dataclasses import replace

import loops
import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.identify.excitation import MOTIONS, motion
from vispeg.robots.model import RobotModel, load

RATE = 500.0


def seven() -> RobotModel:
    """An arm like the iiwa, at 85 % of its speed."""
    half = np.array([2.96706, 2.0944, 2.96706, 2.0944, 2.96706, 2.0944, 3.05433])
    speed = np.array([1.4835, 1.4835, 1.7453, 1.3090, 2.2689, 2.3562, 2.3562])
    return replace(load("iiwa14"), range=np.stack([-half, half], axis=1), velocity_limit=speed)


def two() -> RobotModel:
    return replace(loops.arm(), range=np.array([[-1.0, 2.0], [0.1, 2.5]]), velocity_limit=np.array([0.5, 3.0]))


CASES = [(name, arm) for name in MOTIONS for arm in (seven(), two())]


@pytest.mark.parametrize(("name", "arm"), CASES)
@pytest.mark.parametrize("duration", [3.0, 8.0])
def test_position_and_velocity_stay_inside_eighty_percent(name, arm, duration):
    for seed in range(4):
        m = motion(name, arm, RATE, duration, stream(seed, name))
        middle, half = arm.range.mean(axis=1), np.diff(arm.range, axis=1)[:, 0] / 2.0
        assert (np.abs(m.q_cmd - middle) <= 0.8 * half + 1e-12).all()
        assert (np.abs(m.dq_cmd) <= 0.8 * arm.velocity_limit + 1e-12).all()
        assert m.q_cmd.shape == m.dq_cmd.shape == (round(duration * RATE), len(arm.joints))


@pytest.mark.parametrize(("name", "arm"), CASES)
def test_velocity_is_the_derivative_of_position(name, arm):
    """Central differences at 20 kHz: truncation h^2/6 |q'''| is below 1e-5 rad/s for every motion."""
    m = motion(name, arm, 20000.0, 3.0, stream(1, name))
    slope = (m.q_cmd[2:] - m.q_cmd[:-2]) * 20000.0 / 2.0
    np.testing.assert_allclose(slope, m.dq_cmd[1:-1], atol=1e-5)


@pytest.mark.parametrize(("name", "arm"), CASES)
def test_starts_at_rest_with_no_jump_in_acceleration(name, arm):
    m = motion(name, arm, 20000.0, 3.0, stream(2, name))
    np.testing.assert_allclose(m.dq_cmd[0], 0.0, atol=1e-12)
    np.testing.assert_allclose((m.dq_cmd[1] - m.dq_cmd[0]) * 20000.0, 0.0, atol=0.5)
    assert np.abs(m.dq_cmd).max() > 0.1


@pytest.mark.parametrize("name", MOTIONS)
def test_same_seed_same_motion_other_seed_another(name):
    a, b, c = (motion(name, seven(), RATE, 4.0, stream(seed, name)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(a.q_cmd, b.q_cmd)
    assert np.abs(a.q_cmd - c.q_cmd).max() > 1e-3


def test_fourier_holds_only_the_harmonics_asked_for():
    """Past the ramp the signal is a sum of 0.2, 0.4 ... 1 Hz: least squares on those sines leaves nothing."""
    m = motion("fourier", seven(), RATE, 10.0, stream(0), base_hz=0.2)
    late = m.time >= 2.0
    angle = 2.0 * np.pi * 0.2 * np.arange(6) * m.time[late, None]
    basis = np.hstack([np.sin(angle[:, 1:]), np.cos(angle)])
    left = m.q_cmd[late] - basis @ np.linalg.lstsq(basis, m.q_cmd[late], rcond=None)[0]
    assert np.abs(left).max() < 1e-10


def test_triangle_has_constant_speed_strokes_from_slow_to_fast():
    arm = seven()
    m = motion("triangle", arm, RATE, 6.0, stream(3))
    for j in range(7):
        speed, count = np.unique(np.abs(m.dq_cmd[:, j]).round(9), return_counts=True)
        plateaus = speed[count > 100]
        assert len(plateaus) == 5
        assert plateaus.min() == pytest.approx(0.02, rel=0.02)  # scaled down a little to stay in reach
        assert plateaus.max() > 10.0 * plateaus.min()


def test_chirp_frequency_rises():
    m = motion("chirp", seven(), RATE, 10.0, stream(0), low_hz=0.2, high_hz=4.0)
    turns = [np.count_nonzero(np.diff(np.sign(part), axis=0)) for part in np.array_split(m.dq_cmd, 4)]
    assert turns == sorted(turns) and turns[-1] > 3 * turns[0]


def test_sweep_of_one_joint_leaves_the_others_still():
    m = motion("sweep", seven(), RATE, 5.0, stream(0), joint="joint4")
    still = np.delete(m.q_cmd, 3, axis=1)
    assert (still == still[0]).all() and np.ptp(m.q_cmd[:, 3]) > 0.5


def test_steps_rest_between_moves():
    m = motion("steps", seven(), RATE, 6.0, stream(0))
    assert ((m.dq_cmd == 0.0).mean(axis=0) > 0.2).all()


def test_osc_targets_start_at_the_posture_and_stay_near():
    import mujoco

    xml = "<mujoco><worldbody>{}</worldbody></mujoco>"
    body = "<site name='flange' pos='0 0 .2'/>"
    for i in range(7):
        axis = "0 0 1" if i % 2 == 0 else "0 1 0"
        body = f"<body pos='0 0 .2'><joint axis='{axis}'/><geom type='sphere' size='.05'/>{body}</body>"
    model = mujoco.MjModel.from_xml_string(xml.format(body))
    m = motion("osc", seven(), RATE, 9.0, stream(0), model=model)
    data = mujoco.MjData(model)
    data.qpos[:] = m.q_cmd[0]
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(m.ee_cmd[0, :3], data.site("flange").xpos, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(m.ee_cmd[:, 3:], axis=1), 1.0, atol=1e-12)
    assert (np.abs(m.ee_cmd[:, :3] - m.ee_cmd[0, :3]) <= 0.06 + 1e-12).all()
    assert np.linalg.norm(np.diff(m.ee_cmd[:, :3], axis=0), axis=1).max() * RATE < 0.6  # m/s, no jumps


def test_mistakes_are_explained():
    with pytest.raises(UserError, match="did you mean 'fourier'"):
        motion("furier", seven(), RATE, 4.0, stream(0))
    with pytest.raises(UserError, match="joint4"):
        motion("sweep", seven(), RATE, 4.0, stream(0), joint="joint44")
    with pytest.raises(UserError, match="ten samples"):
        motion("chirp", seven(), RATE, 0.0, stream(0))
    with pytest.raises(UserError, match="inside the position limits"):
        motion("chirp", two(), RATE, 4.0, stream(0), centre=[5.0, 0.0])
