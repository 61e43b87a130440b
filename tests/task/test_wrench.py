"""What a policy is told of the force at its wrist: through the sensor's faults, and only through them."""

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.task.peg.task import PegInHoleVec
from vispeg.worlds.world import World

WRENCH = slice(6, 12)  # of an observation: force in 20 N, torque in 2 N m
SCALE = np.repeat([20.0, 2.0], 3)


def told(*effects: EffectInstance, steps: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Wrench (steps, 6) in N, N m and place of the tip (steps, 3) of an episode that presses on the rim, open loop."""
    env = PegInHoleVec(1, world=World(effects=effects), steps=steps + 1)
    env.reset(seed=3)
    wrench, tip = [], []
    for _ in range(steps):
        seen, *_ = env.step(np.array([[0.05, 0.0, -0.9]]))
        wrench.append(seen["policy"][0, WRENCH] * SCALE)
        tip.append(env.sim.tip_in_goal()[0])
    return np.array(wrench), np.array(tip)


def test_faults_at_null_are_none_bit_by_bit_and_faults_move_nothing():
    names = ("wrench_bias", "wrench_gain", "wrench_noise", "wrench_delay")
    plain, path = told()
    assert np.abs(plain[:, 2]).max() > 5.0, "it touched"
    np.testing.assert_array_equal(told(*(EffectInstance.of(n, "flange") for n in names))[0], plain)
    faulty, same = told(
        EffectInstance.of("wrench_noise", "flange", force=1.0), EffectInstance.of("wrench_bias", "flange", fx=3.0)
    )
    np.testing.assert_array_equal(same, path)
    assert not np.array_equal(faulty, plain)


def test_pressed_down_the_wrist_is_told_of_a_push_up_and_what_is_touched_feels_one_down():
    """At rest on the rim, the force that is told and the contact force that a critic knows agree in all but sign."""
    env = PegInHoleVec(1, world="nominal", steps=40, privileged=True)
    env.reset(seed=3)
    for _ in range(30):
        seen, *_ = env.step(np.array([[0.0, 0.0, -0.5]]))
    up, contact = seen["policy"][0, WRENCH] * SCALE, 20.0 * seen["privileged"][0, 12:15]
    assert up[2] > 5.0
    np.testing.assert_allclose(contact, -up[:3], atol=0.5)


def test_a_bias_is_told_in_the_axes_of_the_base():
    """The flange points down: its x is the base's, its y and z are turned round."""
    bias = {"fx": 2.0, "fy": 3.0, "fz": -4.0, "tx": 0.1, "ty": 0.2, "tz": 0.3}
    off = told(EffectInstance.of("wrench_bias", "flange", **bias))[0] - told()[0]
    turned = np.array(list(bias.values())) * [1, -1, -1, 1, -1, -1]
    np.testing.assert_allclose(off[0], turned, atol=0.02)


def test_a_gain_scales_what_touches_and_leaves_a_share_of_the_tool_s_weight():
    env = PegInHoleVec(1, world="nominal")
    weight = env.sim.seen.weight[2]  # N, negative
    off = told(EffectInstance.of("wrench_gain", "flange", gain=1.1))[0] - told()[0]
    touch = told()[0][:, 2]
    np.testing.assert_allclose(off[:, 2], 0.1 * (touch + weight), rtol=1e-3, atol=1e-3)


def test_a_wrench_of_a_policy_step_ago_is_what_was_told_a_step_ago():
    late = told(EffectInstance.of("wrench_delay", "flange", delay=0.16))[0]
    np.testing.assert_allclose(late[1:], told()[0][:-1], atol=0.1)
