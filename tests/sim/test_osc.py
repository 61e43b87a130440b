"""Operational space control in closed loop: what Khatib's law promises, measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from loops import drive, one
from scipy.spatial.transform import Rotation

from vispeg.control.laws import WORST, hold_pose, osc, rotation_vector, task_inertia
from vispeg.core.seeds import stream
from vispeg.identify.excitation import SEVEN_AXIS_CENTRE
from vispeg.kernels.arm import towards
from vispeg.recordings.recording import Nullspace
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled, flange_pose
from vispeg.sim.nominal import Nominal
from vispeg.sim.rollout import simulate
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
HOME = np.array(SEVEN_AXIS_CENTRE)
POSE = flange_pose(ROBOT, HOME[None])[0]


def moved(step, kp=100.0, kd=14.0, nullspace=None, q0=HOME, seconds=0.8):
    """The flange (n, 7) after its goal jumps by `step` (3,) m at the start; joint angles too."""
    goal = POSE.copy()
    goal[:3] += step
    s = drive(
        ROBOT, "osc", q0, seconds=seconds, command=goal[None], kp=kp, kd=kd, compensation="model", nullspace=nullspace
    )
    y = one(ROBOT, World(), s, want_ee=True)
    assert y.ee is not None
    return s.time, y.ee[0], y.q[0]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_each_direction_answers_as_a_unit_mass(axis):
    """`x'' = kp (goal - x) - kd x'` along the axis of the step, and nothing across it or in orientation.

    The law leaves Coriolis forces out, so this holds to the first order of a small step.
    """
    kp, kd, size = 100.0, 14.0, 0.01
    step = np.zeros(3)
    step[axis] = size
    time, ee, _ = moved(step, kp, kd, Nullspace(10.0, 6.0, HOME))
    decay, omega = kd / 2, np.sqrt(kp - kd**2 / 4)
    answer = 1 - np.exp(-decay * time) * (np.cos(omega * time) + decay / omega * np.sin(omega * time))
    np.testing.assert_allclose(ee[:, axis] - POSE[axis], size * answer, atol=0.01 * size)
    across = np.delete(ee[:, :3] - POSE[:3], axis, axis=1)
    assert np.abs(across).max() < 0.01 * size
    turn = rotation_vector(ee[:, 3:], np.broadcast_to(POSE[3:], (len(ee), 4)))
    assert np.abs(turn).max() < 1e-3


def test_posture_motion_leaves_the_flange_still():
    """The elbow swings by a tenth of a radian and more, while the flange stays where it is."""
    posture = HOME + np.array([0.4, 0, -0.4, 0, 0.4, 0, 0])
    _, ee, q = moved(np.zeros(3), nullspace=Nullspace(10.0, 6.0, posture), kp=400.0, kd=40.0, seconds=1.5)
    assert np.abs(q - HOME).max() > 0.1
    assert np.linalg.norm(ee[:, :3] - POSE[:3], axis=1).max() < 5e-4


def test_damping_takes_task_energy():
    """`v'v / 2 + kp e'e / 2` of the unit mass never rises by more than the loop's delay makes it."""
    kp, kd = 100.0, 8.0
    time, ee, _ = moved(np.array([0.02, -0.01, 0.015]), kp, kd, Nullspace(10.0, 6.0, HOME), seconds=1.0)
    goal = POSE[:3] + [0.02, -0.01, 0.015]
    v = np.gradient(ee[:, :3], time, axis=0)
    energy = 0.5 * np.sum(v**2, axis=1) + 0.5 * kp * np.sum((ee[:, :3] - goal) ** 2, axis=1)
    assert (np.diff(energy[2:-2]) < 2e-4 * energy[0]).all()
    assert energy[-3] < 0.01 * energy[0]


def test_undamped_orbit_keeps_its_size():
    """Without damping the flange swings about its goal and neither grows nor dies within a second."""
    time, ee, _ = moved(np.array([0.01, 0, 0]), 100.0, 0.0, Nullspace(10.0, 6.0, HOME), seconds=1.2)
    x = ee[:, 0] - POSE[0] - 0.01
    early, late = np.abs(x[time < 0.63]).max(), np.abs(x[time > 0.57]).max()
    assert late == pytest.approx(early, rel=0.06)


def test_law_projects_the_posture_out_of_the_task():
    """`J M^-1 (tau with posture - tau without) = 0`, and the task acceleration is the commanded one."""
    rng = stream(4)
    q = HOME + rng.uniform(-0.3, 0.3, (5, 7))
    nominal = Nominal(compiled(ROBOT), ROBOT.joints, ROBOT.flange, 5, 1)
    mass, jac, *_ = nominal.operational(q)
    error, twist = rng.normal(size=(2, 5, 6))
    kp, kd = np.full((5, 6), 50.0), np.full((5, 6), 9.0)
    plain = osc(error, twist, mass, jac, kp, kd)
    posed = osc(error, twist, mass, jac, kp, kd, rng.normal(size=(5, 7)))
    for i in range(5):
        acceleration = jac[i] @ np.linalg.solve(mass[i], np.stack([plain[i], posed[i]], axis=1))
        np.testing.assert_allclose(acceleration.T, [50.0 * error[i] - 9.0 * twist[i]] * 2, atol=1e-8)
    assert np.abs(posed - plain).max() > 0.01


def test_a_singular_direction_asks_for_no_torque():
    """Where a direction is lost, its task inertia is 0 and not infinite."""
    mass, jac = np.eye(7)[None], np.zeros((1, 6, 7))
    jac[0, :5, :5] = np.eye(5)
    lam, _ = task_inertia(mass, jac)
    np.testing.assert_allclose(lam[0], np.diag([1, 1, 1, 1, 1, 0.0]), atol=1e-12)


def test_a_limited_force_is_that_long_at_most():
    rng = stream(5)
    mass, jac = np.eye(6)[None], np.eye(6)[None]
    error, twist = rng.normal(size=(2, 1, 6))
    gains = np.full((1, 6), 10.0)
    limited = osc(error, twist, mass, jac, gains, gains, force_limit=2.0)
    free = osc(error, twist, mass, jac, gains, gains)
    assert np.linalg.norm(limited[0, :3]) == pytest.approx(2.0)
    np.testing.assert_allclose(np.cross(limited[0, :3], free[0, :3]), 0, atol=1e-9)
    np.testing.assert_allclose(limited[0, 3:], free[0, 3:])


vectors = hnp.arrays(float, 3, elements=st.floats(-1.7, 1.7))


@given(vectors, vectors)
def test_rotation_vector_is_the_logarithm(a, b):
    """Against SciPy, for any two orientations short of half a turn apart; the sign of a quaternion does not matter."""
    one, two = Rotation.from_rotvec(a), Rotation.from_rotvec(b)
    expected = (two * one.inv()).as_rotvec()
    if np.linalg.norm(expected) > 3.1:
        return
    q1, q2 = (r.as_quat(scalar_first=True)[None] for r in (one, two))
    np.testing.assert_allclose(rotation_vector(q1, q2)[0], expected, atol=1e-7)
    np.testing.assert_allclose(rotation_vector(-q1, q2)[0], expected, atol=1e-7)


def test_gains_of_a_segment_are_its_own():
    """Two segments with different gains in one batch answer as each does alone."""
    goal = POSE.copy()
    goal[:3] += 0.02
    common = {"seconds": 0.2, "command": goal[None], "compensation": "model", "nullspace": Nullspace(10.0, 6.0, HOME)}
    soft, stiff = (drive(ROBOT, "osc", HOME, kp=kp, kd=kd, **common) for kp, kd in ((50.0, 10.0), (200.0, 25.0)))
    stiff = replace(stiff, control=replace(stiff.control, nullspace=soft.control.nullspace))
    both = simulate(ROBOT, [World()], [soft, stiff])
    for segment, response in zip((soft, stiff), both, strict=True):
        np.testing.assert_array_equal(response.q, one(ROBOT, World(), segment).q)


def situation(rows: int, seed: int = 6):
    """Arms in random postures under random commands: arguments of `hold_pose`."""
    rng = stream(seed, rows)
    q = rng.uniform(0.9 * ROBOT.range[:, 0], 0.9 * ROBOT.range[:, 1], (rows, 7))
    state = Nominal(compiled(ROBOT), ROBOT.joints, ROBOT.flange, rows, 1).operational(q)
    rot = rng.normal(size=(rows, 4))
    rot /= np.linalg.norm(rot, axis=1, keepdims=True)
    kp = np.repeat(rng.uniform(10.0, 2000.0, (rows, 1)), 6, axis=1)
    pull, limit = rng.normal(size=(rows, 7)), rng.uniform(1.0, 100.0, rows)
    dq, pos = rng.normal(size=(rows, 7)), rng.normal(size=(rows, 3))
    return [state, dq, pos, rot, kp, 2 * np.sqrt(kp), pull, limit]


def by_numpy(state, dq, pos, rot, kp, kd, pull, limit):
    """The torque of the same arms as `osc` has it, and the bound of each row's condition."""
    mass, jac, now, turned, _ = state
    turn = Rotation.from_quat(rot, scalar_first=True) * Rotation.from_quat(turned, scalar_first=True).inv()
    error = np.concatenate([pos - now, turn.as_rotvec()], axis=1)
    posture = None if pull is None else np.einsum("nij,nj->ni", mass, pull)
    tau = osc(error, np.einsum("nij,nj->ni", jac, dq), mass, jac, kp, kd, posture, force_limit=limit)
    core = jac @ np.linalg.solve(mass, np.swapaxes(jac, 1, 2))
    return tau, np.trace(core, axis1=1, axis2=2) * np.trace(np.linalg.inv(core), axis1=1, axis2=2)


@pytest.mark.parametrize("rows", [1, 64, 2000])
@pytest.mark.parametrize("bare", [False, True], ids=["posture, limit", "neither"])
def test_compiled_law_is_that_of_numpy(rows, bare):
    """Up to rounding, which the condition of `J M^-1 J'` raises: some thousand in a usual posture, so about 1e-12.

    Half a turn off, the sign of the rotation vector hangs on the last digit: such rows are left out.
    """
    given = situation(rows)
    if bare:
        given[6:] = None, None
    tau, (expected, condition) = hold_pose(*given), by_numpy(*given)
    half = np.linalg.norm(rotation_vector(given[0][3], given[3]), axis=1) > np.pi - 1e-3
    off = np.abs(tau - expected).max(axis=1) / np.abs(expected).max(axis=1)
    assert (off < 4 * np.finfo(float).eps * condition)[~half & (condition < WORST)].all()
    assert np.median(off) < 1e-12


def test_a_row_is_its_own():
    """A row among others, of which some are singular or not finite, gives the bits that it gives alone."""
    given = situation(8)
    given[0][1][2, 5], given[2][4, 1] = 0.0, np.nan
    together = hold_pose(*given)
    for row in (0, 1, 3, 7):
        alone = [part[row : row + 1] for part in given[1:]]
        np.testing.assert_array_equal(
            hold_pose(tuple(part[row : row + 1] for part in given[0]), *alone), together[row : row + 1]
        )
    assert np.isfinite(together[2]).all() and np.isnan(together[4]).all()


@pytest.mark.parametrize("spoil", ["singular", "nearly singular", "nan", "infinite"])
def test_odd_rows_are_those_of_numpy(spoil):
    """A lost direction gets no torque, and what is not finite shows, as the plain law has it to the last bit."""
    state, dq, pos, rot, kp, kd, pull, limit = given = situation(16)
    mass, jac, now, turned, _ = state
    if spoil == "singular":
        jac[:, 4] = 0.0
    elif spoil == "nearly singular":
        jac[:, 4] = jac[:, 3] * (1 + 1e-6)
    else:
        pos[::2, 0], dq[1::2, 3] = (np.nan, np.nan) if spoil == "nan" else (np.inf, -np.inf)
    with np.errstate(invalid="ignore"):
        tau = hold_pose(*given)
        error = np.concatenate([pos - now, rotation_vector(turned, rot)], axis=1)
        twist = np.matmul(jac, dq[:, :, None])[:, :, 0]
        posture = np.matmul(mass, pull[:, :, None])[:, :, 0]
        expected = osc(error, twist, mass, jac, kp, kd, posture, force_limit=limit)
    np.testing.assert_array_equal(tau, expected)
    assert np.isfinite(tau).all() == spoil.endswith("singular")


def test_way_to_a_pose_is_the_weighted_inverse():
    """`q' = pull + M^-1 J' (J M^-1 J' + soft)^-1 (error - J pull)`."""
    state, _, pos, rot, *_, pull, _ = situation(64)
    mass, jac, now, turned, _ = state
    soft, way = 1e-4, np.empty((64, 7))
    towards(mass, jac, now, turned, pos, rot, pull, soft, way)
    light = np.linalg.solve(mass, np.swapaxes(jac, 1, 2))
    error = np.concatenate([pos - now, rotation_vector(turned, rot)], axis=1) - np.einsum("nij,nj->ni", jac, pull)
    expected = pull + np.einsum(
        "nij,nj->ni", light, np.linalg.solve(jac @ light + soft * np.eye(6), error[..., None])[..., 0]
    )
    np.testing.assert_allclose(way, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
