"""Effects at a joint against the textbook equation of a pendulum, in closed form or by SciPy's integrator."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from loops import SWING, WEIGHT, drive, hinge, one, pendulum
from scipy.integrate import solve_ivp

from vispeg.core.effect import effect, searchable
from vispeg.core.seeds import stream
from vispeg.effects.common.presliding import YIELDS
from vispeg.sim.state import DriveState

FLOATING = pendulum(0.0)  # no weight: `SWING ddq = tau`
HANGING = pendulum()


FROM = 20  # sample from which a swing is compared: a rollout begins in balance, a swing does not


def solution(torque, time, q, dq, inertia=SWING):
    """q(t), dq(t) of `inertia ddq = torque(t, q, dq)` from the first sample of q and dq on."""

    def rates(t, y):
        return [y[1], torque(t, y[0], y[1]) / inertia]

    span = (time[0], time[-1])
    return solve_ivp(rates, span, [q[0], dq[0]], t_eval=time, rtol=1e-10, atol=1e-12, max_step=1e-3).y


def coast(world, robot=FLOATING, **options):
    """A passive swing: time, q, dq of the pendulum left to itself."""
    segment = drive(robot, "passive", **options)
    y = one(robot, world, segment, observer=False)
    return segment.time[FROM:], y.q[0, FROM:, 0], y.dq[0, FROM:, 0]


def pushed(world, torque, robot=FLOATING, seconds=0.5, **options):
    """The pendulum from rest under a constant motor torque: time and the whole response."""
    segment = drive(robot, "torque", command=np.array([[torque]]), seconds=seconds, **options)
    return segment.time, one(robot, world, segment, observer=False)


def test_no_effect_is_the_pendulum_equation():
    time, q, dq = coast(hinge("viscous_friction"), HANGING, q0=1.0, seconds=2.0)
    exact, rate = solution(lambda t, q, dq: -WEIGHT * np.sin(q), time, q, dq)
    np.testing.assert_allclose(q, exact, atol=1e-5)
    np.testing.assert_allclose(dq, rate, atol=1e-4)


def test_viscous_friction_decays_exponentially():
    damping = 0.8
    time, q, dq = coast(hinge("viscous_friction", damping=damping), dq0=2.0)
    rate, t = damping / SWING, time - time[0]
    np.testing.assert_allclose(dq, dq[0] * np.exp(-rate * t), atol=2e-5)
    np.testing.assert_allclose(q, q[0] + dq[0] / rate * (1 - np.exp(-rate * t)), atol=5e-6)


def test_coulomb_friction_brakes_evenly_and_then_holds():
    level = 0.5
    time, q, dq = coast(hinge("coulomb_friction", torque=level), dq0=1.0)
    stop = SWING * dq[0] / level
    t = np.minimum(time - time[0], stop)
    np.testing.assert_allclose(q, q[0] + dq[0] * t - level / SWING * t**2 / 2, atol=2e-5)
    assert 0.2 < stop < 0.6
    held = time - time[0] > stop + 0.005
    step = time[1] - time[0]
    assert np.abs(dq[held]).max() < step * level / SWING  # what it reads is less than one step's braking
    assert np.ptp(q[held]) < 2e-6


@pytest.mark.parametrize("name", ["coulomb_friction", "stribeck_friction", "hysteresis"])
def test_dry_friction_holds_below_its_level_and_yields_above(name):
    values = {"torque": 1.0}
    if name == "hysteresis":
        values |= {"stiffness": 3000.0}
    if name == "stribeck_friction":
        values = {"coulomb": 0.6, "excess": 0.4, "velocity": 0.05}
    world = hinge(name, **values)
    ramp = np.minimum(np.arange(500) / 250.0, 1.0)[:, None]
    segments = [drive(FLOATING, "torque", command=level * ramp, seconds=0.5) for level in (0.9, 1.3)]
    below, above = (one(FLOATING, world, s, observer=False) for s in segments)
    play = 1.1 * 1.35 / 3000.0 if name == "hysteresis" else 1e-5  # its springs give: three of four have yielded
    assert np.abs(below.q).max() < play
    assert above.q[0, -1, 0] > 0.02


def test_stribeck_friction_follows_its_curve():
    coulomb, excess, velocity = 0.3, 0.9, 0.2
    time, q, dq = coast(
        hinge("stribeck_friction", coulomb=coulomb, excess=excess, velocity=velocity), dq0=1.5, seconds=0.6
    )

    def level(t, q, dq):
        return -(coulomb + excess * np.exp(-((dq / velocity) ** 2))) * np.tanh(dq / 1e-4)

    exact, rate = solution(level, time, q, dq)
    moving = rate > 0.02
    assert moving.sum() > 300
    np.testing.assert_allclose(q[moving], exact[moving], atol=5e-5)


def test_load_friction_is_a_share_of_the_torque_handed_on():
    share, torque = 0.3, 2.0
    time, y = pushed(hinge("load_friction", coefficient=share), torque)
    handed = torque / (1 + share)  # what is left, f = share (torque - f)
    np.testing.assert_allclose(y.q[0, :, 0], handed / SWING * time**2 / 2, rtol=0.01, atol=1e-4)
    np.testing.assert_allclose(y.tau_joint[0, 10:, 0], handed, rtol=1e-3)


def test_rotor_inertia_is_felt_by_the_motor_only():
    inertia, torque = 0.3, 2.0
    time, y = pushed(hinge("rotor_inertia", inertia=inertia), torque)
    acceleration = torque / (SWING + inertia)
    np.testing.assert_allclose(y.q[0, :, 0], acceleration * time**2 / 2, atol=1e-5)
    np.testing.assert_allclose(y.tau_joint[0, 5:, 0], SWING * acceleration, rtol=1e-6)
    np.testing.assert_allclose(y.tau_motor[0, 5:, 0], torque, rtol=1e-12)


def test_cogging_is_periodic_in_the_angle():
    amplitude, poles, phase = 0.5, 7.0, 0.4
    time, q, dq = coast(hinge("cogging", amplitude=amplitude, poles=poles, phase=phase), q0=0.3, dq0=2.0)
    exact, _ = solution(lambda t, q, dq: amplitude * np.sin(poles * q + phase), time, q, dq)
    np.testing.assert_allclose(q, exact, atol=2e-5)


def test_cable_spring_is_harmonic_about_its_reference():
    stiffness, reference = 20.0, 0.5
    time, q, dq = coast(hinge("cable_spring", stiffness=stiffness, reference=reference), q0=0.2)
    omega, t = np.sqrt(stiffness / SWING), time - time[0]
    exact = reference + (q[0] - reference) * np.cos(omega * t) + dq[0] / omega * np.sin(omega * t)
    np.testing.assert_allclose(q, exact, atol=2e-5)


def test_hysteresis_is_a_spring_before_it_slips():
    stiffness = 100.0
    time, q, dq = coast(hinge("hysteresis", torque=30.0, stiffness=stiffness), dq0=0.1, seconds=0.5)
    omega, t = np.sqrt(stiffness / SWING), time - time[0]
    exact = q[0] * np.cos(omega * t) + dq[0] / omega * np.sin(omega * t)
    np.testing.assert_allclose(q, exact, atol=0.02 * np.abs(exact).max())


def test_hysteresis_drags_its_anchors_once_they_slip():
    """Maxwell elements by SciPy: `ds_i/dt = k dq`, s_i clipped at its share of the torque, through two reversals."""
    stiffness, limit, push = 150.0, 1.0, 3.0
    robot, levels = FLOATING, limit * YIELDS
    time = np.arange(600) / 1000.0
    command = push * np.sin(2 * np.pi * 2.5 * time)
    segment = drive(robot, "torque", command=command[:, None], seconds=0.6)
    y = one(robot, hinge("hysteresis", torque=limit, stiffness=stiffness), segment, observer=False)

    def rates(t, s):
        dq, springs = s[1], s[2:]
        yields = (np.abs(springs) >= levels) & (springs * dq > 0)
        drive_now = push * np.sin(2 * np.pi * 2.5 * max(t - 0.0005, 0.0))  # commands are held for a tick
        pull = np.mean(np.clip(springs, -levels, levels))
        return [dq, (drive_now - pull) / SWING, *np.where(yields, 0.0, stiffness * dq)]

    exact = solve_ivp(rates, (0, time[-1]), np.zeros(2 + len(levels)), t_eval=time, max_step=1e-4).y[0]
    np.testing.assert_allclose(y.q[0, :, 0], exact, atol=0.01 * np.ptp(exact))
    rigid = one(robot, hinge("hysteresis"), segment, observer=False).q[0, :, 0]
    assert np.abs(rigid - exact).max() > 0.1 * np.ptp(exact)  # the tolerance above says something


@pytest.mark.parametrize("name", [n for n, kind in searchable().items() if kind.overrides("along")])
def test_torque_along_a_path_is_that_of_its_steps_however_long_it_took(name):
    """What a step-by-step simulation makes of a joint that is led along a path, at rest in between as well."""
    kind, rng = effect(name), stream(3, "along", name)
    turns = np.cumsum(rng.uniform(-1.0, 1.0, (25, 2)) * [2e-2, 3e-3], axis=0)
    path = np.concatenate([np.linspace(a, b, 40)[:-1] for a, b in itertools.pairwise(turns)] + [turns[-1:]] * 20)
    p = {k: np.full((1, 2), param.start) for k, param in kind.params.items()}
    p |= {m: p[m] * [[1.0, 0.3]] for m in kind.magnitudes}

    def state(q):
        return DriveState(
            1e-6, 1e-6, q[None], np.zeros((1, 2)), np.zeros((1, 2)), np.full((1, 2), -4.0), np.full((1, 2), 9.0)
        )

    carried, steps = kind.start(state(path[0]), p), []
    for q in path:
        steps.append(kind.torque(carried, state(q), p)[0])
    x, every = state(path[0]), np.arange(len(path))
    np.testing.assert_allclose(kind.along(path, every, x, p), steps, atol=1e-9)
    twice = np.repeat(path, 2, axis=0)
    np.testing.assert_allclose(kind.along(twice, 2 * every, x, p), steps, atol=1e-9)
    none = {k: np.full((1, 2), v) for k, v in ((k, param.absent) for k, param in kind.params.items())}
    assert not np.any(kind.along(path, every, x, none)), "null"


@pytest.mark.parametrize(
    "world",
    [
        hinge("viscous_friction", damping=0.5),
        hinge("coulomb_friction", torque=0.5),
        hinge("stribeck_friction", coulomb=0.3, excess=0.3, velocity=0.1),
        hinge("load_friction", coefficient=0.1),
        hinge("hysteresis", torque=0.5, stiffness=200.0),
        hinge("cogging", amplitude=0.5, poles=9.0),
        hinge("rotor_inertia", inertia=0.2),
        hinge("joint_bias", torque=0.7),
        hinge("torque_gain", gain=0.9),
        hinge("actuator_lag", time_constant=0.01),
        hinge("command_delay", delay=0.004),
        hinge("joint_elasticity", compliance=1e-3, motor_inertia=0.1),
    ],
    ids=lambda w: w.effects[0].effect,
)
def test_a_joint_torque_sensor_reads_what_moves_the_link(world):
    """Behind the gear: `tau = SWING ddq + WEIGHT sin q` of the true link motion, whatever happens in the drive."""
    time = np.arange(800) / 1000.0
    goal = 0.8 * np.sin(2 * np.pi * 1.5 * time)[:, None]
    rate = 0.8 * 2 * np.pi * 1.5 * np.cos(2 * np.pi * 1.5 * time)[:, None]
    segment = drive(HANGING, "position", dq0=rate[0], command=goal, dq_cmd=rate, seconds=0.8, kp=200.0, kd=8.0)
    y = one(HANGING, world, segment, want_ee=True)
    assert y.ee is not None
    q = np.unwrap(np.arctan2(-y.ee[0, :, 0], -y.ee[0, :, 2]))  # the flange hangs at -z: its angle is the true one
    ddq = np.gradient(np.gradient(q, 0.001), 0.001)
    expected = SWING * ddq + WEIGHT * np.sin(q)
    inner = slice(100, -5)
    error = y.tau_joint[0, inner, 0] - expected[inner]
    assert np.sqrt(np.mean(error**2)) < 0.02 * np.ptp(expected[inner])


def test_friction_under_a_changing_load_is_along_a_path_what_its_steps_make():
    """Load and path swing at different rates; the memory of the mean load is right to some percent of the level."""
    kind, at = effect("load_friction"), np.arange(4000)
    q, load = 0.4 * np.sin(at / 300.0)[:, None], (3.0 + np.sin(at / 170.0))[:, None]
    p = {"coefficient": np.full((1, 1), 0.2), "stiffness": np.full((1, 1), 1e3)}

    def state(q, tau):
        return DriveState(1e-6, 1e-6, q, np.zeros_like(q), np.zeros_like(q), tau, np.full_like(q, 9.0))

    carried = kind.start(state(q[:1], load[:1]), p)
    steps = np.concatenate([kind.torque(carried, state(a[None], b[None]), p) for a, b in zip(q, load, strict=True)])
    error = kind.along(q, at, state(q, load), p) - steps
    assert np.sqrt(np.mean(error**2)) < 0.05 * np.sqrt(np.mean(steps**2))
    assert np.abs(steps).max() > 0.75 and np.abs(steps[np.abs(steps) > 0.3]).std() > 0.1, "the load matters"
