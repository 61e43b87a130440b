"""Position servos: what a goal makes of a joint, in closed form on a pendulum without weight."""

from __future__ import annotations

import numpy as np
import pytest
from loops import SWING, WEIGHT, drive, hinge, one, pendulum

from vispeg.core.effect import EffectInstance
from vispeg.effects.common.servo_loop import FAST
from vispeg.sim.segments.segment import Segment
from vispeg.worlds.world import World

FLOATING, RATE, AT = pendulum(0.0), 400.0, 40  # Hz, and the row at which the goal steps


def stepped(world, goal, robot=FLOATING, seconds=0.6, q0=0.0, **options):
    """Time since the step, angle and torque of a servo that is sent `goal` (n,) rad, or a number from row AT on."""
    n = round(seconds * RATE)
    sent = np.asarray(goal, float) if np.ndim(goal) else np.where(np.arange(n) >= AT, goal, q0)
    hold = drive(robot, "servo", q0, seconds=seconds, rate=RATE)
    segment = Segment(
        hold.control, hold.tick, {"q_cmd": sent[:, None]}, hold.q, hold.dq, hold.q_raw, hold.time, hold.rows
    )
    y = one(robot, world, segment, **options)
    return np.maximum(segment.time - AT / RATE, 0.0), y.q[0, :, 0], y.tau_motor[0, :, 0], y.dq[0, :, 0]


def second_order(t, w, z):
    """Unit step response of w^2 / (s^2 + 2 z w s + w^2)."""
    root = np.sqrt(complex(z * z - 1.0))
    fast, slow = -w * (z + root), -w * (z - root)
    if abs(root) < 1e-9:
        return 1.0 - np.exp(-w * t) * (1.0 + w * t)
    return 1.0 - np.real((fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (fast - slow))


@pytest.mark.parametrize(("w", "z"), [(25.0, 0.5), (25.0, 1.0), (25.0, 2.5), (60.0, 0.2), (10.0, 4.0)])
def test_a_step_is_that_of_a_second_order_system(w, z):
    goal, gain, step = 0.1, 0.9, 5e-4
    t, q, *_ = stepped(hinge("servo", natural_frequency=w, damping_ratio=z, gain=gain), goal, h_max=step)
    np.testing.assert_allclose(q, goal * gain * second_order(t, w, z), atol=goal * (w * step) ** 2)


def test_the_step_is_of_second_order():
    """A fifth of the step leaves a twenty-fifth of the error."""
    error = {}
    for step in (2.5e-3, 5e-4):
        t, q, *_ = stepped(hinge("servo", natural_frequency=40.0, damping_ratio=0.7), 0.1, h_max=step)
        error[step] = np.abs(q - 0.1 * second_order(t, 40.0, 0.7)).max()
    assert error[2.5e-3] / error[5e-4] == pytest.approx(25.0, rel=0.3)


def test_a_servo_of_which_nothing_is_said_follows_its_goal():
    t, q, *_ = stepped(World(), 0.1, h_max=5e-4)
    np.testing.assert_allclose(q, 0.1 * second_order(t, FAST, 1.0), atol=1e-3)
    assert np.abs(q[t > 0.06] - 0.1).max() < 1e-3


def test_weight_bends_a_soft_servo():
    """At rest `J w^2 (goal - q)` carries the weight, J the pendulum's inertia."""
    w, goal = 20.0, 0.6
    _, q, tau, _ = stepped(hinge("servo", natural_frequency=w), goal, pendulum(), seconds=2.0)
    np.testing.assert_allclose(SWING * w**2 * (goal - q[-1]), WEIGHT * np.sin(q[-1]), rtol=1e-3)
    np.testing.assert_allclose(tau[-1], WEIGHT * np.sin(q[-1]), rtol=1e-3)


def test_a_rate_limited_goal_is_a_ramp():
    """Behind the limit the servo follows a ramp: `rate (t - lag)`, lag 2 zeta / w, once the start has died away."""
    w, z, rate = 60.0, 1.0, 0.5
    world = hinge("servo", natural_frequency=w, damping_ratio=z).add(*hinge("goal_rate_limit", rate=rate).effects)
    t, q, _, dq = stepped(world, 0.3, seconds=1.0, h_max=5e-4)
    ramp = (t > 0.2) & (t < 0.5)
    np.testing.assert_allclose(q[ramp], rate * (t[ramp] - 2 * z / w), atol=rate * 5e-4)
    assert dq.max() < rate * (1 + 1e-3) and q[-1] == pytest.approx(0.3, abs=1e-3)


def test_delay_moves_the_goal_not_the_loop():
    """A servo behind a delay answers later and no otherwise: its own loop reads its own encoder at once."""
    prompt = hinge("servo", natural_frequency=60.0, damping_ratio=0.3)
    late = prompt.add(EffectInstance.of("command_delay", "hinge", delay=0.03))
    q, delayed = stepped(prompt, 0.2)[1], stepped(late, 0.2)[1]
    ticks = round(0.03 * RATE)
    np.testing.assert_allclose(delayed[ticks:], q[:-ticks], atol=1e-9)
    log = prompt.add(EffectInstance.of("sensor_delay", "hinge", delay=0.03))
    np.testing.assert_allclose(stepped(log, 0.2)[1][ticks:], q[:-ticks], atol=1e-9)


def test_torque_falls_along_the_line_of_a_motor():
    """Far from its goal a saturated servo runs up as `dq = no_load (1 - exp(-t stall / (J no_load)))`."""
    stall, no_load = 4.0, 3.0
    world = World().add(EffectInstance.of("torque_speed_limit", "hinge", stall=stall, no_load=no_load))
    t, _, tau, dq = stepped(world, 2.0, seconds=0.4, h_max=5e-4)
    run = (t > 0.005) & (t < 0.2)
    np.testing.assert_allclose(
        dq[run], no_load * (1 - np.exp(-t[run] * stall / (SWING * no_load))), atol=0.01 * no_load
    )
    np.testing.assert_allclose(tau[run], stall * (1 - dq[run] / no_load), atol=0.02 * stall)


def test_a_motor_brakes_with_all_its_torque():
    """Against the motion the current limits, not the supply's voltage: the line holds in one direction only."""
    kind = EffectInstance.of("torque_speed_limit", "hinge", stall=4.0, no_load=3.0)
    fast = drive(FLOATING, "torque", dq0=2.0, command=np.array([[-9.0]]), seconds=0.05, rate=1000.0)
    y = one(FLOATING, World().add(kind), fast, observer=False)
    assert (y.dq[0] > 0).all()
    np.testing.assert_allclose(y.tau_motor[0, 2:, 0], -4.0)


def test_a_dead_band_is_not_answered():
    band = World().add(EffectInstance.of("dead_band", "hinge", width=0.04))
    _, q, tau, _ = stepped(band, 0.019)
    assert not q.any() and not tau.any()
    t, q, *_ = stepped(band, 0.1, h_max=5e-4)
    np.testing.assert_allclose(q, 0.08 * second_order(t, FAST, 1.0), atol=1e-3)  # as if sent the band's near edge


def test_dry_friction_holds_what_the_loop_cannot_move():
    """A goal within friction / stiffness moves nothing; the torque at rest is the loop's, to rounding."""
    w, torque = 20.0, 1.0
    world = hinge("servo", natural_frequency=w).add(*hinge("coulomb_friction", torque=torque).effects)
    reach = torque / (SWING * w**2)
    _, q, tau, _ = stepped(world, 0.9 * reach)
    assert np.abs(q).max() < 1e-4
    assert tau[-1] == pytest.approx(0.9 * torque, rel=1e-3)
    assert stepped(world, 1.5 * reach)[1][-1] == pytest.approx(0.5 * reach, rel=0.15)
