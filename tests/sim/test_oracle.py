"""Rollouts against the slow and obvious: a loop of plain `mj_step` at a small step, and how the two converge."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from loops import COM, GRAVITY, MASS, SWING, WEIGHT, drive, iiwa_segment, one, pendulum
from scipy.integrate import solve_ivp

from vispeg.control.laws import osc, rotation_vector
from vispeg.core.effect import EffectInstance
from vispeg.robots.model import load
from vispeg.sim.rollout import simulate
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
FINE = 40  # physics steps a control tick of the oracle: its own error is far below the bound


def oracle(segment, edit=lambda model: None) -> np.ndarray:
    """Angles (n, 7): one simulation, Runge-Kutta, the controller written out, nothing of the rollout's loop."""
    model = ROBOT.compile()
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = segment.tick / FINE
    edit(model)
    data, know, clean = mujoco.MjData(model), mujoco.MjData(ROBOT.compile()), ROBOT.compile()
    data.qpos[:], data.qvel[:] = segment.q[0], segment.dq[0]
    c, out = segment.control, []
    for k in range(segment.ticks):
        out.append(data.qpos.copy())
        know.qpos[:], know.qvel[:] = data.qpos, 0
        mujoco.mj_forward(clean, know)
        gravity = know.qfrc_bias.copy()
        if c.mode == "position":
            error, rate = segment.command["q_cmd"][k] - data.qpos, segment.command["dq_cmd"][k] - data.qvel
            tau = c.kp * error + c.kd * rate + gravity
        elif c.mode == "osc":
            tau = _osc(clean, know, data.qvel, segment.command["ee_cmd"][k], c) + gravity
        else:
            tau = segment.command["tau_cmd"][k] + (gravity if c.gravity_compensation == "model" else 0)
        data.ctrl[:] = tau
        for _ in range(FINE):
            mujoco.mj_step(model, data)
    return np.array(out)


def _osc(model, know, dq, goal, c):
    mass, jac = np.zeros((7, 7)), np.zeros((6, 7))
    mujoco.mj_fullM(model, know, mass)
    site = model.site("flange").id
    mujoco.mj_jacSite(model, know, jac[:3], jac[3:], site)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, know.site_xmat[site])
    turn = rotation_vector(quat[None], goal[None, 3:])[0]
    error = np.concatenate([goal[:3] - know.site_xpos[site], turn])
    null = c.nullspace
    posture = mass @ (null.kp * (null.q - know.qpos) - null.kd * dq)
    args = (a[None] for a in (error, jac @ dq, mass, jac, c.kp, c.kd, posture))
    return osc(*args)[0]


@pytest.mark.parametrize(("mode", "h_max"), [("position", 1e-3), ("osc", 1e-3), ("torque", 2.5e-4)])
def test_rollout_is_plain_mujoco(mode, h_max):
    """Under 5 microradians over half a second: less than any noise, and in open loop before the arm runs away."""
    segment = iiwa_segment(mode, 0.5)
    got = one(ROBOT, World(), segment, observer=False, h_max=h_max).q[0]
    assert np.abs(got - oracle(segment)).max() < 5e-6


def test_rollout_with_effects_is_plain_mujoco():
    """The same with damping, rotor inertia and a spring, which the oracle has in its model."""
    world = World().add(
        EffectInstance.of("viscous_friction", "joint4", damping=3.0),
        EffectInstance.of("rotor_inertia", "joint6", inertia=0.2),
        EffectInstance.of("cable_spring", "joint2", stiffness=8.0, reference=0.5),
    )

    def edit(model):
        model.dof_damping[3], model.dof_armature[5] = 3.0, 0.2
        model.jnt_stiffness[1], model.qpos_spring[1] = 8.0, 0.5

    segment = iiwa_segment("position", 0.5)
    got, nominal = (one(ROBOT, w, segment, h_max=5e-4).q[0] for w in (world, World()))
    assert np.abs(got - oracle(segment, edit)).max() < 5e-6
    assert np.abs(got - nominal).max() > 1e-3


def test_dry_friction_is_the_textbook_discontinuity():
    """Coulomb friction in a servo against an oracle with its own stick-slip logic on the pendulum."""
    robot, level, inertia = pendulum(0.0), 0.6, 0.2
    time = np.arange(800) / 1000.0
    goal = 0.4 * (1 - np.cos(2 * np.pi * 1.5 * time))[:, None]
    rate = 0.4 * 2 * np.pi * 1.5 * np.sin(2 * np.pi * 1.5 * time)[:, None]
    segment = drive(robot, "position", command=goal, dq_cmd=rate, seconds=0.8, kp=80.0, kd=4.0)
    got = one(robot, World().add(EffectInstance.of("coulomb_friction", "hinge", torque=level)), segment, h_max=5e-4).q[
        0, :, 0
    ]
    fine, q, dq, out = 100, 0.0, 0.0, []
    h = 1e-3 / fine
    for k in range(800):
        out.append(q)
        tau = 80.0 * (goal[k, 0] - q) + 4.0 * (rate[k, 0] - dq)
        for _ in range(fine):
            free = dq + h * tau / inertia  # friction stops the joint, or takes its level off
            dq = np.sign(free) * max(abs(free) - h * level / inertia, 0.0)
            q += h * dq
    np.testing.assert_allclose(got, out, atol=2e-4)
    rigid = one(robot, World(), segment).q[0, :, 0]
    assert np.abs(rigid - out).max() > 3e-3


def test_order_of_accuracy_is_two():
    """Halving the step divides the error by four, in closed and in open loop."""
    for mode in ("position", "torque"):
        segment = iiwa_segment(mode, 0.4)

        def angles(n, segment=segment):
            return one(ROBOT, World(), segment, observer=False, h_max=2e-3 / n).q[0]

        exact = angles(64)
        errors = [np.sqrt(np.mean((angles(n) - exact) ** 2)) for n in (2, 4, 8)]
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        assert (orders > 1.8).all() and (orders < 2.3).all(), (mode, orders)


def test_free_swing_keeps_its_energy():
    """A pendulum swings for five seconds with no drift of its energy: `SWING dq^2 / 2 - m g c cos q`."""
    robot = pendulum()
    y = one(robot, World(), drive(robot, "passive", 1.2, seconds=5.0), observer=False)
    energy = 0.5 * SWING * y.dq[0, 20:, 0] ** 2 - MASS * GRAVITY * COM * np.cos(y.q[0, 20:, 0])
    assert np.ptp(energy) < 1e-4 * MASS * GRAVITY * COM
    first, last = energy[:1000].mean(), energy[-1000:].mean()
    assert abs(last - first) < 1e-5 * MASS * GRAVITY * COM


@pytest.mark.parametrize("name", ["viscous_friction", "coulomb_friction"])
def test_friction_only_takes_energy(name):
    robot = pendulum()
    value = {"damping": 0.3} if name == "viscous_friction" else {"torque": 0.3}
    y = one(
        robot,
        World().add(EffectInstance.of(name, "hinge", **value)),
        drive(robot, "passive", 1.2, seconds=2.0),
        observer=False,
    )
    energy = 0.5 * SWING * y.dq[0, 20:, 0] ** 2 - MASS * GRAVITY * COM * np.cos(y.q[0, 20:, 0])
    assert (np.diff(energy) < 2e-5 * MASS * GRAVITY * COM).all()
    assert energy[-1] < energy[0] - 0.5


def test_rows_do_not_know_of_each_other():
    """Worlds and segments of one batch give bit for bit what each gives alone, over any number of threads."""
    worlds = [
        World(),
        *(World().add(EffectInstance.of("viscous_friction", j, damping=1.0)) for j in ("joint2", "joint6")),
    ]
    segments = [iiwa_segment("position", 0.3, seed=s) for s in (0, 1)]
    together = simulate(ROBOT, worlds, segments, nthread=2)
    for s, response in zip(segments, together, strict=True):
        for w, world in enumerate(worlds):
            np.testing.assert_array_equal(response.q[w], one(ROBOT, world, s).q[0])


def test_divergence_is_said_and_stays_in_its_row():
    """A servo with the wrong sign of damping blows up alone: its row is NaN, its neighbour's what it was."""
    s = iiwa_segment("position", 0.5)
    wild = World().add(EffectInstance.of("command_delay", "all", delay=0.03))
    pair = simulate(ROBOT, [wild, World()], [s])[0]
    assert pair.diverged.tolist() == [True, False]
    assert np.isnan(pair.q[0]).all()
    np.testing.assert_array_equal(pair.q[1], one(ROBOT, World(), s).q[0])
    seen = simulate(ROBOT, [wild, World()], [s], want_ee=True)[0]
    for values in (seen.ee, seen.true):
        assert np.isnan(values[0]).all() and np.isfinite(values[1]).all()


def test_what_comes_after_a_short_segment_does_not_count():
    """Beside a longer one it is held on after its end; that it runs wild there is nothing that was asked."""
    wild = World().add(EffectInstance.of("command_delay", "all", delay=0.03))
    short, long = iiwa_segment("position", 0.05), iiwa_segment("position", 0.5)
    first, second = simulate(ROBOT, [wild], [short, long])
    assert not first.diverged[0] and second.diverged[0]
    np.testing.assert_array_equal(first.q, one(ROBOT, wild, short).q)


def test_gravity_along_the_measured_motion_is_nearly_exact():
    """The first-order gravity of candidates near the measurement costs under a microradian for a friction of 2 N m."""
    world = World().add(EffectInstance.of("coulomb_friction", "joint4", torque=2.0))
    s = iiwa_segment("position", 0.6)
    measured = one(ROBOT, world, s).q[0]
    near = replace(s, q=measured, q_raw=measured)
    exact, quick = (one(ROBOT, World(), near, along=along).q[0] for along in (False, True))
    assert np.abs(quick - exact).max() < 1e-6
    assert np.abs(measured - exact).max() > 1e-3


def test_observer_holds_a_torque_driven_arm_and_leaves_its_truth_alone():
    """Open loop, a wrong model drifts off; held softly it stays near, and the right model is not moved at all."""
    s = iiwa_segment("torque", 1.0)
    truth = one(ROBOT, World(), s, observer=False)
    rate = np.gradient(truth.q[0], s.tick, axis=0)
    s = replace(s, q=truth.q[0], dq=rate, q_raw=truth.q[0])
    wrong = World().add(EffectInstance.of("joint_bias", "joint2", torque=2.0))
    free, held = (one(ROBOT, wrong, s, observer=o).q[0] for o in (False, True))
    assert np.abs(free - truth.q[0]).max() > 5 * np.abs(held - truth.q[0]).max()
    assert np.abs(one(ROBOT, World(), s, observer=True).q[0] - truth.q[0]).max() < 2e-4


def test_samples_between_ticks_are_interpolated():
    """A log at 333 Hz of a 1 kHz loop lies on the loop's own motion."""
    robot = pendulum()
    s = drive(robot, "passive", 1.0, seconds=1.0)
    times = np.arange(300) / 333.0
    y = one(robot, World(), replace(s, time=times, rows=np.arange(300)), observer=False).q[0, :, 0]
    full = one(robot, World(), s, observer=False).q[0, :, 0]
    np.testing.assert_allclose(y, np.interp(times, s.time, full), atol=1e-12)


def test_pendulum_with_a_held_torque_is_its_ode():
    """A command held for 10 ms at a time, as SciPy integrates it."""
    robot, rng = pendulum(), np.random.default_rng(0)
    command = rng.normal(size=(60, 1))
    s = drive(robot, "torque", command=command, seconds=0.6, rate=100.0)
    got = one(robot, World(), s, observer=False, h_max=1e-3).q[0, :, 0]
    y, out = np.zeros(2), []
    for tau in command[:, 0]:
        out.append(y[0])
        y = solve_ivp(lambda t, y, tau=tau: [y[1], (tau - WEIGHT * np.sin(y[0])) / SWING], (0, 0.01), y, rtol=1e-9).y[
            :, -1
        ]
    np.testing.assert_allclose(got, out, atol=5e-6)
