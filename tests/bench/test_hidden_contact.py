"""The contact benchmark's plant against mechanics: springs, cones, rebound, wedging, energy, and the project's cell."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from arm import rigid
from contact_arm import apparent, forward, joints, quaternion, rotation_vector
from contact_cases import DEV, GRID, cases, hide
from contact_geometry import GROUP, Shape, contacts
from contact_make import path_error, stream, wrench
from contact_motions import MOTIONS, SETS, path
from contact_plant import DOWN, KP, MOUTH, PEG, RATE, TIP, Plant, Truth, held, nominal_tool, run

POSTURE = np.array([[0.3, 0.5, -0.2, -1.2, 0.4, 0.9, 0.1]])
NOMINAL = Truth()


def sizes(n=1, **other):
    one = np.ones(n)
    values = {"peg": PEG, "hole": 0.0095, "chamfer": 1e-3, "depth": 0.025, "block": 0.05, "table": -0.05, "pad": 0.0,
              "bump": 0.0}  # fmt: skip
    return Shape(**{k: one * v for k, v in (values | other).items()})


def led(points, truths, seconds=None, limit=25.0):
    """The plants led through [(s, x, y, z in mm)], upright; the commanded path is linear."""
    times, tips = np.array([p[0] for p in points]), np.array([p[1:] for p in points]) * 1e-3
    t = np.arange(round((seconds or times[-1]) * RATE)) / RATE
    tip = MOUTH + np.stack([np.interp(t, times, tips[:, i]) for i in range(3)], axis=1)
    pos = np.tile(tip + [0, 0, TIP], (len(truths), 1, 1))
    rot = np.tile(DOWN, (len(truths), len(t), 1, 1))
    return run(list(truths), pos, rot, np.full(len(truths), limit))


def test_the_arm_is_that_of_its_table():
    model = rigid()
    data = mujoco.MjData(model)
    data.qpos[:] = POSTURE[0]
    mujoco.mj_forward(model, data)
    pos, rot, jac = forward(POSTURE)
    site = model.site("flange").id
    assert np.allclose(pos[0], data.site_xpos[site], atol=1e-12)
    assert np.allclose(rot[0], data.site_xmat[site].reshape(3, 3), atol=1e-12)
    full, jp, jr = np.zeros((7, 7)), np.zeros((3, 7)), np.zeros((3, 7))
    for i in range(7):  # the mass matrix column by column, from the bias of unit accelerations
        data.qacc[:] = np.eye(7)[i]
        data.qvel[:] = 0.0
        mujoco.mj_inverse(model, data)
        full[:, i] = data.qfrc_inverse - data.qfrc_bias
    mujoco.mj_jacSite(model, data, jp, jr, site)
    assert np.allclose(jac[0], np.vstack([jp, jr]), atol=1e-12)
    both = np.vstack([jp, jr])
    assert np.allclose(apparent(POSTURE[0]), np.linalg.inv(both @ np.linalg.solve(full, both.T)), rtol=1e-8)


def test_joint_angles_bring_the_flange_to_its_path():
    pos, rot = path(SETS["turned-datum-tap"])
    q = joints(pos[::100], rot[::100])
    here, turned, _ = forward(q)
    assert np.abs(here - pos[::100]).max() < 1e-7
    assert np.abs(rotation_vector(np.swapaxes(turned, 1, 2) @ rot[::100])).max() < 1e-6
    assert np.abs(np.diff(q, axis=0)).max() < 0.8  # no jump of the elbow


def test_what_is_held_is_the_projects_tool():
    from vispeg.robots.scene import build

    model = build().nominal.compile()
    tool, peg = model.body("tool").id, model.body("peg").id
    mass, com, _ = nominal_tool()
    assert abs(model.body_mass[tool] - mass) < 1e-9 and np.allclose(model.body_ipos[tool], com)
    whole, *_ = held(NOMINAL)
    assert abs(model.body_mass[[tool, peg]].sum() - whole) < 1e-9


def test_a_press_is_a_spring():
    """F = k x: pressed flat by a constant force, a peg sinks by force over stiffness, three times a contact's, and by
    force times compliance where the fixture gives way.
    """
    soft = replace(NOMINAL, fixture=(0.0, 0.0, 3e-5, 0.0, 0.0))
    place, body = np.tile(MOUTH + [0.03, 0, TIP + 1e-5], (2, 1)), np.diag([5.0] * 3 + [0.1] * 3)
    plant = Plant([NOMINAL, soft], place, np.tile(DOWN, (2, 1, 1)), np.zeros(2), body)
    for _ in range(3000):
        plant.command[:, 2] = -12.0 - 400.0 * plant.vel[:, 2]
        plant.step(2e-4)
    assert np.allclose(plant.force[:, 2], 12.0, rtol=1e-3)
    sunk = plant.pos[:, 2] - (MOUTH[2] + TIP)
    assert sunk[0] == pytest.approx(-12.0 / 3e6, rel=0.01)
    assert sunk[1] - sunk[0] == pytest.approx(-3e-5 * 12.0, rel=0.01)


@pytest.mark.slow
def test_friction_stays_in_its_cone_and_slides_on_it():
    rough = replace(NOMINAL, friction=0.51)
    log = led(
        [(0, 30, -25, 2), (0.2, 30, -25, 2), (0.7, 30, -25, -5), (0.8, 30, -25, -5), (1.9, 30, 15, -5)],
        [NOMINAL, rough],
    )
    drag, load = np.linalg.norm(log.force[..., :2], axis=2), log.force[..., 2]
    touching = load > 1
    for row, mu in enumerate((0.3, 0.51)):
        assert (drag[row] <= mu * load[row] * 1.001 + 1e-9)[touching[row]].all()
        steady = np.arange(log.force.shape[1]) > 1.75 * RATE
        assert np.median(drag[row, steady] / load[row, steady]) == pytest.approx(mu, rel=0.01)


@pytest.mark.slow
def test_what_sticks_stays():
    """A sideways pull inside the cone bends the contact by microns and no further."""
    pulled = [(0.7, 30, 0, -8), (0.9, 30, 0, -8), (1.2, 30, 1.5, -8), (2.4, 30, 1.5, -8)]
    log = led([(0, 30, 0, 2), (0.2, 30, 0, 2), *pulled], [replace(NOMINAL, friction=0.9)])
    late = log.tip[0, round(1.6 * RATE) :]
    assert np.ptp(late[:, 1]) < 2e-6 and abs(late[-1, 1]) < 1e-4
    drag = np.linalg.norm(log.force[0, -1, :2])
    assert 0.5 < drag < 0.9 * log.force[0, -1, 2]


def falling(speed, h, truth, mass=5.0, seconds=0.06):
    """Speeds of a peg that falls flat on the top without a command or weight."""
    body = np.diag([mass] * 3 + [0.1] * 3)
    plant = Plant([truth], (MOUTH + [0.03, 0, TIP + 1e-4])[None], DOWN[None], np.zeros(1), body)
    plant.vel[:] = [[0.0, 0.0, -speed]]
    plant.felt[:] = mass + held(truth)[0]
    out = []
    for _ in range(round(seconds / h)):
        plant.step(h)
        out.append((plant.vel[0, 2], plant.energy[0]))
    return np.array(out)


@pytest.mark.parametrize(
    ("chi", "speed"), [(40.0, 0.05), *(pytest.param(*p, marks=pytest.mark.slow) for p in ((10.0, 0.05), (148.0, 0.02)))]
)
def test_a_tap_rebounds_as_hunt_and_crossley_say(chi, speed):
    """With y = chi v: y - ln(1 + y) = -e y - ln(1 - e y): the work of both halves of a blow, in closed form."""
    from scipy.optimize import brentq

    y = chi * speed
    e = brentq(lambda e: y - np.log1p(y) + e * y + np.log1p(-e * y), 1e-6, min(1.0, 1 / y) - 1e-9)
    got = falling(speed, 1e-5, replace(NOMINAL, damping=chi, hold=1e9), seconds=0.02)[-1, 0] / speed
    assert got == pytest.approx(e, abs=0.03)


@pytest.mark.slow
def test_energy_is_never_made():
    rng = np.random.default_rng(0)
    truths = [NOMINAL, replace(NOMINAL, friction=0.9, damping=10.0), replace(NOMINAL, fixture=(3e-5, 0, 3e-5, 3e-3, 0))]
    plant = Plant(truths, np.tile(MOUTH + [0.03, 0, TIP + 5e-4], (3, 1)), np.tile(DOWN, (3, 1, 1)), np.zeros(3))
    plant.vel[:] = [[0.05, 0.02, -0.1]] * 3
    plant.spin[:] = 0.05 * rng.standard_normal((3, 3))
    energy = []
    for _ in range(2500):
        plant.step(4e-5)
        energy.append(plant.energy)
    energy = np.array(energy)
    start = energy[0]
    assert (energy.max(axis=0) <= 1.03 * start).all()
    assert (energy[-1] < 0.9 * start).all()


def test_a_tilted_peg_wedges_at_two_points():
    """Two-point contact in a plane: rim at the wall, edge at the side, where insertion and tilt fit the clearance."""
    lean, hole, c = 0.12, 0.0095, 1e-3
    u = np.array([np.sin(lean), 0.0, np.cos(lean)])  # the top leans to +x, so the rim's far side is at -x
    x = -(hole - PEG * np.cos(lean))
    # the edge (hole, -c) is PEG from the axis: ((hole - x) cos - (-c - z) sin) = PEG
    z = -c - ((hole - x) * np.cos(lean) - PEG) / np.sin(lean)
    points, normals, depth = contacts(np.array([[x, 0.0, z]]), u[None], sizes())
    wall, bevel, edge = depth[0, -3:]
    assert abs(wall) < 1e-7 and abs(edge) < 1e-7 and bevel < 0
    assert np.allclose(normals[0, -3], [1, 0, 0], atol=1e-9) and normals[0, -1, 0] < -0.99
    assert np.allclose(points[0, -1], [hole, 0, -c])
    deeper = contacts(np.array([[x, 0.0, z - 5e-4]]), u[None], sizes())[2][0, -3:]
    assert deeper[2] > 0  # there is no room


@pytest.mark.slow
def test_a_peg_rocked_in_the_hole_stays_within_what_its_controller_can_push():
    """Two contacts across a light hand at once: an explicit damper would pump energy into it."""
    pos, rot = path(("rock",))
    some = slice(round(0.7 * RATE), round(1.9 * RATE))
    truths = [NOMINAL, replace(NOMINAL, fixture=(3e-5, 0, 0, 8e-3, 0)), replace(NOMINAL, grasp=(8e-5, 8e-5, 0, 0, 0))]
    log = run(truths, np.tile(pos[some], (3, 1, 1)), np.tile(rot[some], (3, 1, 1, 1)), np.full(3, 25.0))
    assert np.linalg.norm(log.wrench[:, :, :3], axis=2).max() < 60.0
    assert np.linalg.norm(log.pos - pos[some], axis=2).max() < 0.05
    assert log.energy.max() < 1.0
    assert np.abs(log.force[:, -100:]).max() > 3.0, "it wedges"


def test_an_upright_peg_in_the_middle_touches_nothing_and_at_the_wall_once():
    up = np.array([[0.0, 0.0, 1.0]])
    free = contacts(np.array([[1e-9, 0.0, -0.015]]), up, sizes())[2]
    assert free.max() < 0
    angle = 0.7
    at = (0.0015 + 2e-5) * np.array([np.cos(angle), np.sin(angle)])
    _, normals, depth = contacts(np.array([[*at, -0.015]]), up, sizes())
    assert depth[0, -3] == pytest.approx(2e-5, rel=1e-6) and depth[0, -1] == pytest.approx(2e-5, rel=1e-3)
    assert np.allclose(normals[0, -3, :2], -np.array([np.cos(angle), np.sin(angle)]))
    assert (depth[0, GROUP == 0] < 0).all()


def test_every_effect_changes_what_is_measured_and_null_changes_nothing():
    singles = [c for c in cases() if c.kind == "single"]
    assert len(singles) == 2 * len(GRID) and len(cases()) >= 80
    assert all(c.truth != NOMINAL for c in singles)
    assert hide(NOMINAL, "contact_friction", {"scale": 1.0}) == NOMINAL
    assert len({c.key for c in cases()}) == len(cases())
    assert {c.seed for c in cases()} != {c.seed for c in cases(DEV)}


def test_sensors_err_as_they_say():
    pos, _ = path(("free", "slide"))
    sizes_of = [np.sqrt(np.mean(np.sum(path_error(pos, stream(i)) ** 2, axis=1))) for i in range(40)]
    assert 2e-5 < min(sizes_of) and max(sizes_of) < 3.5e-4 and 5e-5 < np.median(sizes_of) < 2e-4
    still = np.tile([0.0, 0, -8.0, 0, 0, 0], (2000, 1))
    read = wrench(still, replace(NOMINAL, bias=(1.0, 0, 0, 0, 0, 0), gain=1.1), stream("a"), stream("b"))
    assert np.std(np.diff(read[:, 2])) / np.sqrt(2) == pytest.approx(0.2, rel=0.1)
    assert np.mean(read[:200, 2]) == pytest.approx(-8.8, abs=0.3)
    # a bias is of what the tool puts on the flange; what is recorded acts on the tool
    assert np.mean(read[:200, 0]) == pytest.approx(-1.0, abs=0.5)


def test_every_motion_begins_at_rest_in_free_air():
    for name in MOTIONS:
        pos, _ = path((name,))
        assert np.ptp(pos[: round(0.3 * RATE)], axis=0).max() == 0
        assert pos[0, 2] - TIP - MOUTH[2] > 0.02


@pytest.mark.slow
def test_the_projects_cell_presses_and_slides_alike():
    """Matched and quasi-static: normal force within 12 %, friction within 0.02, depth within 0.1 mm."""
    from vispeg.task.rig.commanded import CellMotion
    from vispeg.task.rig.record import record_cell
    from vispeg.worlds.model_file import load_model

    points = [
        (0, 30, -5, 2),
        (0.2, 30, -5, 2),
        (0.7, 30, -5, -5),
        (1.0, 30, -5, -5),
        (1.9, 30, 15, -5),
    ]
    mine = led(points, [NOMINAL])
    t = np.arange(mine.pos.shape[1]) / RATE
    tips = np.array([p[1:] for p in points]) * 1e-3
    tip = MOUTH + np.stack([np.interp(t, [p[0] for p in points], tips[:, i]) for i in range(3)], axis=1)
    goal = np.concatenate([tip + [0, 0, TIP], np.tile(quaternion(DOWN[None]), (len(t), 1))], axis=1)
    made = CellMotion("press", t, goal, stiffness=(KP[0], KP[3]))
    rec = record_cell(load_model("peg-cell"), made, {}, np.random.default_rng(0), rate_hz=RATE)
    weight = held(NOMINAL)[0] * 9.81
    pressed, sliding = (t > 0.85) & (t < 1.0), (t > 1.75) & (t < 1.85)
    theirs, ours = rec.ft, mine.wrench[0]
    up = [(w[pressed, 2] + weight).mean() for w in (theirs, ours)]
    assert 8 < up[1] < 25
    assert abs(up[0] / up[1] - 1) < 0.12
    mu = [np.median(np.abs(w[sliding, 1]) / np.abs(w[sliding, 2] + weight)) for w in (theirs, ours)]
    assert abs(mu[0] - mu[1]) < 0.02
    height = rec.ee[pressed, 2].mean() - mine.pos[0, pressed, 2].mean()
    assert abs(height) < 1e-4
