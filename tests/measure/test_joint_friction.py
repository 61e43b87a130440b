"""Friction of joints that MuJoCo turns: beside gravity, inertia and the loop's lag its intervals hold the truth."""

from functools import lru_cache

import mujoco
import numpy as np
import pytest

from vispeg.measure import friction_curve, joint, loops
from vispeg.measure.plan import plan
from vispeg.measure.trace import Trace
from vispeg.robots.model import load

RATE = 500.0
JOINT = """
<mujoco><option timestep="0.0005" integrator="implicitfast"/><worldbody><body>
  <joint name="j" axis="0 1 0" armature="{armature}" damping="{damping}" frictionloss="{coulomb}"
    solreffriction="0.001 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"/>
  <inertial pos="{com} 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody></mujoco>
"""


@lru_cache
def motions():
    parts = plan(load("iiwa14"), "joint1", 0.0, 0.1, RATE, np.random.default_rng(0))
    return [p for p in parts if p.name in ("ladder", "triangle")]


def turned(part, rng, servo, coulomb=1.0, damping=0.5, com=0.3, armature=0.1, wn=20.0, zeta=0.7, excess=0.0):
    """The joint under tau = J (wn^2 (q_cmd - q) - 2 zeta wn dq), held for a sample; of a servo for a physics step."""
    m = mujoco.MjModel.from_xml_string(JOINT.format(coulomb=coulomb, damping=damping, com=com, armature=armature))
    d = mujoco.MjData(m)
    inertia = armature + 0.01 + com**2
    kp, kd = inertia * wn**2, 2 * inertia * zeta * wn
    n = round(1 / RATE / m.opt.timestep)
    q, tau = np.empty(len(part.offset)), np.empty(len(part.offset))
    d.qpos[0] = part.offset[0]
    for k, goal in enumerate(part.offset):
        q[k] = d.qpos[0]
        for sub in range(n):
            if servo or sub == 0:
                d.qfrc_applied[0] = kp * (goal - d.qpos[0]) - kd * d.qvel[0]
            if not servo and sub == 0:
                tau[k] = d.qfrc_applied[0]
            if excess:
                m.dof_frictionloss[0] = coulomb + excess * np.exp(-((d.qvel[0] / 0.05) ** 2))
            mujoco.mj_step(m, d)
        if servo and k + 1 < len(tau):
            tau[k + 1] = d.qfrc_applied[0]  # as it stands when the next row is read
    tau[0] = tau[1]
    q += 2e-5 * rng.standard_normal(len(q))
    return Trace(part.name, part.time, part.offset, q, tau + 0.03 * rng.standard_normal(len(q)), servo=servo)


def measured(seed, servo, **joint_of):
    rng = np.random.default_rng(seed)
    found = joint.measure([turned(p, rng, servo, **joint_of) for p in motions()], rng)
    return {q.quantity: q for q in found.results}, found.notes


@pytest.mark.parametrize("servo", [False, True])
def test_intervals_hold_friction_beside_gravity_inertia_and_lag(servo):
    """Of twelve numbers of six joints 95 % intervals miss three or more with a probability of 2 %."""
    held = 0
    for seed in range(6):
        r = np.random.default_rng([seed, servo])
        truth = {"coulomb": r.uniform(0.3, 2.0), "damping": r.choice([0.0, r.uniform(0.2, 1.5)])}
        loop = {"com": r.uniform(0.0, 0.4), "armature": r.uniform(0.05, 0.4), "wn": r.uniform(14.0, 40.0)}
        by_name, notes = measured(seed, servo, **truth, **loop, zeta=r.uniform(0.5, 1.1))
        for name, key in (("coulomb_friction", "coulomb"), ("viscous_friction", "damping")):
            held += by_name[name].low <= truth[key] <= by_name[name].high
        assert by_name["coulomb_friction"].value == pytest.approx(truth["coulomb"], rel=0.02)
        assert not any("Stribeck" in note for note in notes)
    assert held >= 10


def test_stribeck_friction_is_said_where_it_is_and_leaves_coulomb_friction_alone():
    by_name, notes = measured(1, False, excess=0.3, zeta=1.1)
    assert any("Stribeck" in note for note in notes)
    q = by_name["coulomb_friction"]
    assert q.low <= 1.0 <= q.high and q.u < 0.05


def test_speed_and_acceleration_of_a_stroke_are_those_of_the_rows_that_weigh_its_torque():
    """A torque of J ddq + b dq on an angle whose speed is not steady: the height is J a + b v by those shares."""
    t = np.arange(0, 4, 1 / RATE)
    command = 0.1 * (1 - np.abs(t / 2 - 1))
    bend = 2e-3 * np.sin(3 * t)
    q = command + bend
    dq, ddq = 0.05 * np.sign(2 - t) + 6e-3 * np.cos(3 * t), -18e-3 * np.sin(3 * t)
    (stroke,) = loops.measured(Trace("bent", t, command, q, 3.0 * ddq + 2.0 * dq))
    assert abs(stroke.acceleration) > 1e-3
    assert stroke.friction == pytest.approx(3.0 * stroke.acceleration + 2.0 * stroke.speed, rel=1e-3)


def test_heights_that_share_a_way_vary_together():
    """Of white torque noise: the covariance over 400 draws is the one by which the heights are weighted."""
    t = np.arange(0, 6, 1 / RATE)
    q = 0.1 * np.abs(np.mod(t / 2 + 1, 2) - 1)
    rng, heights = np.random.default_rng(5), []
    for _ in range(400):
        strokes = loops.measured(Trace("noise", t, q, q, rng.standard_normal(len(t))))
        heights.append([s.friction for s in strokes])
    predicted = friction_curve._covariance(strokes)
    assert predicted.shape == (2, 2) and predicted[0, 1] > 0.3 * predicted[0, 0]
    assert np.cov(np.transpose(heights)) == pytest.approx(predicted, rel=0.3)


def test_strokes_in_which_the_joint_sticks_say_nothing():
    """A loop of 80 N m/rad winds up by 3 / 80 rad each way before the joint breaks away: short strokes end first."""
    by_name, notes = measured(2, False, coulomb=3.0)
    assert any("strokes are left out: the joint starts or sticks" in note for note in notes)
    assert by_name["lost_motion"].value == pytest.approx(2 * 3.0 / 80.0, rel=0.03)
    assert by_name["coulomb_friction"].value == pytest.approx(3.0, rel=0.02)
