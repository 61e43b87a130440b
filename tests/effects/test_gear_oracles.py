"""Elasticity and backlash against a two-mass model integrated by SciPy."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from loops import SWING, drive, hinge, iiwa_segment, one, pendulum
from scipy.integrate import solve_ivp

from vispeg.core.effect import EffectInstance
from vispeg.effects.common.gear import STEP
from vispeg.robots.model import load
from vispeg.sim.rollout import simulate
from vispeg.worlds.world import World

FLOATING = pendulum(0.0)


def smooth_push(seconds, peak=2.0, period=0.25):
    """A torque (n,) at 1 kHz that starts from 0."""
    return peak * np.sin(2 * np.pi * np.arange(round(1000 * seconds)) / 1000.0 / period)


def two_masses(time, torque, inertia, gear):
    """Motor and link angles of `inertia theta'' = tau - s`, `SWING q'' = s`, s = gear(theta - q, theta' - q')."""

    def rates(t, y):
        s = gear(y[0] - y[2], y[1] - y[3])
        tau = torque[min(int(t * 1000 + 1e-9), len(torque) - 1)]
        return [y[1], (tau - s) / inertia, y[3], s / SWING]

    y = solve_ivp(rates, (0, time[-1]), np.zeros(4), t_eval=time, max_step=2e-4, rtol=1e-8, atol=1e-10).y
    return y[0], y[2]


def link_angle(y):
    return np.arctan2(-y.ee[0, :, 0], -y.ee[0, :, 2])


@pytest.mark.parametrize("inertia", [0.15, 1e-3])
@pytest.mark.parametrize("compliance", [1e-3, 2e-4])
def test_elasticity_is_two_masses_and_a_spring(compliance, inertia):
    relaxation = 5e-3
    torque = smooth_push(0.5)
    segment = drive(FLOATING, "torque", command=torque[:, None], seconds=0.5)
    world = hinge("joint_elasticity", compliance=compliance, relaxation=relaxation, motor_inertia=inertia)
    y = one(FLOATING, world, segment, observer=False, want_ee=True)
    theta, q = two_masses(segment.time, torque, inertia, lambda d, r: (d + relaxation * r) / compliance)
    np.testing.assert_allclose(link_angle(y), q, atol=3e-5)
    np.testing.assert_allclose(y.q[0, :, 0], theta, atol=3e-5)
    wind_up = compliance * 2.0 * SWING / (SWING + inertia)
    np.testing.assert_allclose(y.q[0, :, 0] - link_angle(y), theta - q, atol=0.05 * wind_up)


def test_elasticity_without_a_rotor_shifts_the_reading_by_the_torque():
    """A massless motor: the link moves as if rigid, the encoder reads `compliance tau` more, a little later."""
    compliance, relaxation = 1e-3, 1e-3
    torque = smooth_push(0.5)
    segment = drive(FLOATING, "torque", command=torque[:, None], seconds=0.5)
    world = hinge("joint_elasticity", compliance=compliance, relaxation=relaxation)
    y = one(FLOATING, world, segment, observer=False, want_ee=True)
    rigid = one(FLOATING, hinge("joint_elasticity"), segment, observer=False)
    np.testing.assert_allclose(link_angle(y), rigid.q[0, :, 0], atol=1e-9)
    lagged = np.interp(segment.time - relaxation, segment.time, torque)
    shift = y.q[0, :, 0] - link_angle(y)
    np.testing.assert_allclose(shift[20:], compliance * lagged[20:], atol=0.04 * compliance * 2.0)


@pytest.mark.parametrize("relaxation", [1e-3, 2e-2])
def test_the_speed_without_a_rotor_is_read_at_the_instant_of_the_angle(relaxation):
    """`relaxation delta' = compliance tau - delta`; a reading half a step late would be 4 mrad/s off."""
    compliance, torque = 1e-3, smooth_push(0.5)
    segment = drive(FLOATING, "torque", command=torque[:, None], seconds=0.5)
    world = hinge("joint_elasticity", compliance=compliance, relaxation=relaxation)
    y = one(FLOATING, world, segment, observer=False)

    def rates(t, delta):
        return (compliance * torque[min(int(t * 1000 + 1e-9), 499)] - delta) / relaxation

    delta = solve_ivp(rates, (0, 0.5), [0.0], t_eval=segment.time, max_step=2e-4, rtol=1e-8, atol=1e-10).y[0]
    link = np.concatenate([[0.0], np.cumsum(torque[:-1]) * 1e-3 / SWING])
    winds = (compliance * np.concatenate([[0.0], torque[:-1]]) - delta) / relaxation
    np.testing.assert_allclose(y.dq[0, :, 0], link + winds, atol=2e-3)


def test_open_backlash_turns_the_rotor_alone():
    """Until the teeth have crossed the gap the link does not move and the reading follows the rotor's inertia."""
    gap, inertia, push = 0.02, 0.1, -1.0
    torque = np.where(np.arange(200) >= 20, push, 0.0)
    segment = drive(FLOATING, "torque", command=torque[:, None], seconds=0.2)
    y = one(FLOATING, hinge("backlash", gap=gap, motor_inertia=inertia), segment, observer=False, want_ee=True)
    t = np.maximum(segment.time - 0.02, 0.0)
    free = y.q[0, 0, 0] + push / inertia * t**2 / 2
    crossing = np.sqrt(2 * gap * inertia / -push)
    before = t < crossing - 0.003
    np.testing.assert_allclose(y.q[0, before, 0], free[before], atol=3e-5)
    np.testing.assert_allclose(link_angle(y)[before], link_angle(y)[0], atol=1e-9)
    assert link_angle(y)[-1] < -1e-3  # afterwards the teeth drive the link


def test_backlash_keeps_momentum():
    """Motor and link together: `inertia theta' + SWING q'` is the impulse of the torque, through every hit."""
    inertia = 0.1
    torque = smooth_push(0.6, period=0.2)
    segment = drive(FLOATING, "torque", command=torque[:, None], seconds=0.6)
    y = one(FLOATING, hinge("backlash", gap=0.01, motor_inertia=inertia), segment, observer=False, want_ee=True)
    link = np.gradient(link_angle(y), segment.time)
    momentum = inertia * y.dq[0, :, 0] + SWING * link
    impulse = np.concatenate([[0.0], np.cumsum(torque[:-1]) * 1e-3])
    error = momentum - impulse
    assert np.sqrt(np.mean(error[5:] ** 2)) < 0.05 * np.ptp(impulse)
    play = y.q[0, :, 0] - link_angle(y)
    assert play.max() - play.min() == pytest.approx(0.01, rel=0.1)


def test_closed_backlash_is_the_rigid_arm_with_a_heavier_motor():
    """Under a torque that never reverses the teeth stay in touch: `(SWING + inertia) q'' = tau`."""
    inertia = 0.2
    torque = np.where(np.arange(400) >= 20, 1.5, 0.0)
    segment = drive(FLOATING, "torque", command=torque[:, None], seconds=0.4)
    y = one(FLOATING, hinge("backlash", gap=0.01, motor_inertia=inertia), segment, observer=False, want_ee=True)
    t = np.maximum(segment.time - 0.02, 0.0)
    np.testing.assert_allclose(link_angle(y) - link_angle(y)[0], 1.5 / (SWING + inertia) * t**2 / 2, atol=1e-4)


@pytest.mark.parametrize(
    "name, corners",
    [
        ("backlash", {"gap": (1e-4, 5e-3), "motor_inertia": (0.005, 0.2, 3.0), "compliance": (5e-6, 3e-5, 2e-4)}),
        (
            "joint_elasticity",
            {"compliance": (1e-6, 1e-5), "relaxation": (5e-4, 5e-2), "motor_inertia": (0.0, 0.2, 5.0)},
        ),
    ],
)
def test_a_stiff_gear_is_stable_on_every_joint(name, corners):
    """At 1 ms; a link's coast predicted half a step late diverged on the wrist and the shoulder."""
    robot, segment = load("iiwa14"), iiwa_segment("torque", 1.0, seed=1)
    worlds = [
        World().add(EffectInstance.of(name, joint, **dict(zip(corners, values, strict=True))))
        for joint, *values in product(robot.joints, *corners.values())
    ]
    moved = np.ptp(simulate(robot, worlds, [segment], h_max=STEP)[0].q, axis=1)
    assert moved.max() < np.pi  # not NaN
