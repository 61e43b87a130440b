"""Drive and sensor effects: what they do to a torque or a reading, in closed form on a pendulum without weight."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from loops import SWING, drive, hinge, one, pendulum

from vispeg.core.effect import effect
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.localise import JointData
from vispeg.effects.common.delay import DelayLine
from vispeg.sim.physics import EffectLoop
from vispeg.sim.placement import activate
from vispeg.sim.plant import Plant
from vispeg.sim.state import DriveState
from vispeg.worlds.world import World

FLOATING = pendulum(0.0)
TICK = 1e-3


def angle(world, torque, **options):
    """Time, measured angle and response of the pendulum from rest under a motor torque (n,) or a number."""
    command = np.atleast_1d(np.asarray(torque, float))[:, None]
    segment = drive(FLOATING, "torque", command=command, seconds=0.4, **options)
    y = one(FLOATING, world, segment, observer=False, want_ee=True)
    return segment.time, y.q[0, :, 0], y


@pytest.mark.parametrize(
    ("world", "current", "delivered"),
    [
        (hinge("torque_gain", gain=1.2), 2.0, 1.2 * 2.0),
        (hinge("joint_bias", torque=-0.5), 2.0, 2.0 - 0.5),
        (hinge("torque_limit", limit=1.5), 1.5, 1.5),
        (hinge("torque_limit", limit=2.5), 2.0, 2.0),
        (hinge("torque_gain", gain=1.2).add(*hinge("joint_bias", torque=-0.5).effects), 2.0, 1.2 * 2.0 - 0.5),
        (hinge("torque_limit", limit=1.5).add(*hinge("joint_bias", torque=-0.5).effects), 1.5, 1.5 - 0.5),
    ],
    ids=["gain", "bias", "limit", "limit out of reach", "gain before bias", "limit before bias"],
)
def test_static_drive(world, current, delivered):
    """A torque from the motor's current shows a limit, and no error of the torque that the current makes."""
    time, q, y = angle(world, 2.0)
    np.testing.assert_allclose(y.tau_motor[0, 5:, 0], current, rtol=1e-12)
    np.testing.assert_allclose(y.tau_joint[0, 5:, 0], delivered, rtol=1e-12)
    acceleration = delivered / SWING
    from_rest = q - q[20] - (y.dq[0, 20, 0] * (time - time[20]))
    np.testing.assert_allclose(from_rest[20:], acceleration * (time[20:] - time[20]) ** 2 / 2, atol=1e-6)


def test_the_inverse_of_a_drive_is_the_command_that_it_turned_into_the_torque():
    """Gain 1.2, then bias 6: of 10 N m commanded 18 are delivered, and 18 needed are 10 commanded."""
    loop = EffectLoop(
        activate(FLOATING, [hinge("torque_gain", gain=1.2).add(*hinge("joint_bias", torque=6.0).effects)])
    )
    command, one_row = np.array([[10.0]]), np.zeros((1, 1))
    delivered, _ = loop.drive(command, DriveState(TICK, TICK, *[one_row] * 5))
    assert delivered == pytest.approx(18.0)
    assert loop.inverse(delivered, "motor") == pytest.approx(command)
    assert loop.inverse(command, "joint") == pytest.approx(delivered), "a sensor's own gain and zero, in their order"


def test_torque_limit_is_two_sided():
    _, q, y = angle(hinge("torque_limit", limit=1.5), -2.0)
    np.testing.assert_allclose(y.tau_motor[0, 5:, 0], -1.5)
    assert q[-1] < 0


def test_actuator_lag_approaches_its_command_exponentially():
    constant, torque = 0.02, 2.0
    step = np.where(np.arange(400) >= 50, torque, 0.0)
    time, q, y = angle(hinge("actuator_lag", time_constant=constant), step)
    t = np.maximum(time - 0.05, 0.0)
    reached = torque * (1 - np.exp(-t / constant))
    exact = torque / SWING * (t**2 / 2 - constant * t + constant**2 * (1 - np.exp(-t / constant)))
    np.testing.assert_allclose(q, exact, atol=1e-5)
    np.testing.assert_allclose(y.tau_motor[0, 51:, 0], (reached[50:-1] + reached[51:]) / 2, atol=0.003 * torque)


@pytest.mark.parametrize("delay", [0.004, 0.0065, 0.03])
def test_command_delay_is_dead_time(delay):
    """The torque's mean over each step is the command's of `delay` ago, for whole and for broken numbers of steps."""
    torque = 2.0
    step = np.where(np.arange(400) >= 50, torque, 0.0)
    time, q, y = angle(hinge("command_delay", delay=delay), step)
    t = np.maximum(time - 0.05 - delay, 0.0)
    np.testing.assert_allclose(q, torque / SWING * t**2 / 2, atol=3e-6)
    assert not y.tau_motor[0, time < 0.05 + delay - TICK, 0].any()
    np.testing.assert_array_equal(y.tau_motor[0, time > 0.05 + delay + 2 * TICK, 0], torque)


@pytest.mark.parametrize("delay", [0.005, 0.0123])
def test_sensor_delay_shows_the_past(delay):
    torque = 3.0 * np.sin(np.arange(400) / 30.0)
    time, true, _ = angle(World(), torque)
    _, late, y = angle(hinge("sensor_delay", delay=delay), torque)
    np.testing.assert_allclose(late, np.interp(time - delay, time, true), atol=1e-9)
    assert y.ee is not None  # the link itself is not late
    np.testing.assert_allclose(np.arctan2(-y.ee[0, :, 0], -y.ee[0, :, 2]), true, atol=1e-9)


@given(
    values=st.lists(st.floats(-10, 10), min_size=3, max_size=30),
    whole=st.integers(0, 7),
    part=st.floats(0, 1, exclude_max=True),
)
def test_delay_line_is_linear_interpolation(values, whole, part):
    line, got = DelayLine(0.5, 4.5), []
    for v in values:
        got.append(line(np.array([[v]]), np.array([[0.5 * (whole + part)]]))[0, 0])
    at = np.arange(len(values)) - whole - part
    np.testing.assert_allclose(got, np.interp(at, np.arange(len(values)), values), atol=1e-9)


def test_encoder_offset_is_measured_minus_true():
    """A servo brings the reading to its command, so the link ends `offset` short of it."""
    offset, goal = 0.03, 0.4
    segment = drive(FLOATING, "position", goal, seconds=1.5, kp=100.0, kd=9.0)
    y = one(FLOATING, hinge("encoder_offset", offset=offset), segment, want_ee=True)
    assert y.ee is not None
    true = np.arctan2(-y.ee[0, :, 0], -y.ee[0, :, 2])
    np.testing.assert_allclose(y.q[0, :, 0] - true, offset, atol=1e-12)
    np.testing.assert_allclose(y.q[0, -1, 0], goal, atol=1e-6)


def test_encoder_quantization_rounds_to_its_grid():
    step = 2e-3
    torque = 3.0 * np.sin(np.arange(400) / 30.0)
    _, true, _ = angle(World(), torque)
    _, read, y = angle(hinge("encoder_quantization", step=step), torque)
    np.testing.assert_allclose(read / step, np.round(read / step), atol=1e-9)
    assert np.abs(read - true).max() <= 0.5 * step + 1e-12
    assert len(np.unique(read)) > 20


@pytest.mark.parametrize(
    ("world", "shift"),
    [
        (hinge("encoder_quantization", step=1e-3), 0.0),
        (hinge("encoder_offset", offset=0.03).add(*hinge("encoder_quantization", step=1e-3).effects), 0.03),
    ],
    ids=["rounded", "shifted and rounded"],
)
def test_an_arm_starts_where_its_encoders_stand_not_where_their_rounded_readings_would_be_right(world, shift):
    plant, asked = Plant(FLOATING, [world], TICK, TICK, 1), np.array([[0.1004]])
    plant.start(asked, np.zeros((1, 1)), np.zeros((1, 1)), np.ones((1, 1)))
    np.testing.assert_allclose(plant.x.q, asked - shift, atol=1e-15)


@pytest.mark.parametrize("readings", [3, 40, 200, 256, 300, 2000])
def test_a_step_under_noise_is_guessed_however_few_the_readings_are(readings):
    """From a swing of 0.4 rad with 20 um of noise on a step of 1 mrad; of three readings nothing is guessed."""
    swing = 0.2 * np.sin(np.linspace(0.0, 5.0, readings))
    raw = np.round(swing / 1e-3) * 1e-3 + stream(4, "step").normal(0.0, 2e-5, readings)
    guesses = effect("encoder_quantization").guesses(JointData(*[swing] * 6, raw))
    assert [g["step"] for g in guesses] == pytest.approx([1e-3] if readings > 3 else [], rel=0.01)


@pytest.mark.parametrize("step", [1e-5, 4e-5, 3e-4, 2e-3])
def test_what_noise_does_to_a_coarse_reading(step):
    """The RMS between two roundings, one with noise, is that of a million drawn angles."""
    sigma, rng = 4e-5, stream(3, "rounding")
    x, n = rng.uniform(0, 1, 1_000_000), rng.normal(0, sigma, 1_000_000)
    drawn = step * np.sqrt(np.mean((np.rint((x + n) / step) - np.rint(x / step)) ** 2))
    kind = effect("encoder_quantization")
    np.testing.assert_allclose(kind.reading_noise(sigma, {"step": step}), drawn, rtol=0.02)
    assert kind.reading_noise(sigma, {"step": 0.0}) == sigma
