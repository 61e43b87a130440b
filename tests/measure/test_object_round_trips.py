"""What is hidden in the cell, read by noisy instruments, measured and put into a model gives the same readings again.

The readings are of the cell with its arm clamped (`clamped.bench`), or of equations of rest that share no code with
the package. Each is read ten times over with other noise: intervals of 95 % that miss the truth in four or more of ten
have a probability of 0.1 %.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from clamped import BESIDE, SLIP, TOP, G, bench, contact_force, written

from vispeg.cli.main import main
from vispeg.core.effect import EffectInstance
from vispeg.recordings.recording import Control, Recording
from vispeg.recordings.write import write
from vispeg.robots.model import load
from vispeg.sim.compiled import flange_pose
from vispeg.worlds.measurement_file import load_measurement
from vispeg.worlds.model_file import load_model
from vispeg.worlds.world import World


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def one(name, where="peg", **values):
    return World().add(EffectInstance.of(name, where, **values))


SEEDS, LEAST = 10, 7


def measured(protocol, columns, truth, *argv, model="peg-cell", **within):
    """The world that `measure` and `add` make of readings, and the effect's parameters in it; intervals are counted.

    Columns by name, of a random generator.
    """

    def read(r):
        table = columns(r)
        head = ",".join(table)
        np.savetxt("t.csv", np.column_stack(list(table.values())), delimiter=",", header=head, comments="", fmt="%.9g")
        return "t.csv", *argv

    return added(protocol, read, truth, model, **(within or {"rel": 0.1}))


def added(protocol, read, truth, model, **within):
    held, first = 0, None
    for seed in range(SEEDS):
        file = f"found{seed}.yaml"
        if main(["measure", protocol, *read(np.random.default_rng(seed)), "--out", file]) != 0:
            continue  # chance that looks like a drift, in one of two hundred
        first = first or file
        params = load_measurement(file).effects[0].params
        held += all(params[name].low <= value <= params[name].high for name, value in truth.items())
    assert held >= LEAST
    assert main(["add", model, first, "--out", "model.yaml"]) == 0
    (effect,) = load_model("model.yaml").effects
    for name, value in truth.items():
        assert effect.params[name].value == pytest.approx(value, **within)
    return World().add(effect), effect.params


def weights(worlds):
    batch = bench(worlds, (*BESIDE, TOP + 1e-5), 2e-4)
    batch.step(nstep=600)
    return np.array([contact_force(batch, row)[2] for row in range(len(worlds))])


def test_a_mass_survives_the_round_trip():
    truth = one("object_mass", scale=1.3)
    kg = float(weights([truth])[0]) / G

    def readings(r):
        return {"mass": np.round(kg + 2e-4 * r.standard_normal(8), 4)}

    found, _ = measured("mass", readings, {"scale": 1.3}, "--where", "peg", "--resolution", "mass=1e-4")
    again = weights([truth, found])
    assert again[1] == pytest.approx(again[0], abs=3 * 2e-4 * G)


def drawn(worlds):
    """Tangential and normal force (n, nsim) while the peg is drawn over the fixture's top, pressed down."""
    batch = bench(worlds, (*BESIDE, TOP + 1e-5), 2e-4)
    batch.bind("qvel")[:, 0] = 0.1 / BESIDE[0]
    batch.bind("qfrc_applied")[:, SLIP] = 20.0
    batch.step(nstep=300)
    forces = []
    for _ in range(30):
        batch.step(nstep=5)
        forces.append([contact_force(batch, row) for row in range(len(worlds))])
    forces = np.array(forces)
    return np.hypot(forces[..., 0], forces[..., 1]), forces[..., 2]


def test_friction_survives_the_round_trip():
    truth = one("contact_friction", scale=1.5)
    forces = {name: x[x > 1.0] for name, x in zip(("tangential", "normal"), drawn([truth]), strict=True)}

    def readings(r):
        return {name: x + 0.1 * r.standard_normal(len(x)) for name, x in forces.items()}

    found, _ = measured("friction", readings, {"scale": 1.5}, "--resolution", "normal=0.01", "tangential=0.01")
    tangential, normal = (x.sum(axis=0) for x in drawn([truth, found]))
    assert tangential[1] / normal[1] == pytest.approx(tangential[0] / normal[0], abs=0.1 / 20 * 1.5)


def touches(worlds, height):
    """Times (nsim, 3) s at which the peg, let go at `height` m over the fixture, comes to touch it."""
    batch = bench(worlds, (*BESIDE, TOP + height), 1e-4)
    qpos, way = batch.bind("qpos"), []
    for _ in range(round(2.6e4 * np.sqrt(2 * height / G))):
        batch.step()
        way.append(qpos[:, SLIP].copy())
    return np.array([np.flatnonzero(np.diff((x > height).astype(int)) > 0)[:3] for x in np.array(way).T]) * 1e-4


def test_restitution_survives_the_round_trip():
    """To 2 %: a touch of the model lasts 10 ms, in which gravity acts, and between onsets it counts as flight."""
    truth, heights = one("restitution", e=0.5), (0.2, 0.3)
    exact = np.concatenate([np.repeat(touches([truth], h), 5, axis=0) for h in heights])

    def readings(r):
        times = exact + 1e-3 * r.standard_normal(exact.shape)
        return dict(zip(("t1", "t2", "t3", "drop"), [*times.T, np.repeat(heights, 5)], strict=True))

    digits = ["--resolution", "t1=1e-4", "t2=1e-4", "t3=1e-4", "drop=1e-4"]
    found, params = measured("restitution", readings, {}, *digits)
    assert params["e"].value == pytest.approx(0.5, rel=0.02)
    again = np.diff(touches([truth, found], 0.25), axis=1)
    assert again[1] == pytest.approx(again[0], rel=0.03)


def depths(worlds, loads, soft):
    """Depth (nload, nsim) m of the peg under each load (N); `soft`, with the arm's compliance (m/N) in it."""
    batch = bench(worlds, (*BESIDE, TOP), 5e-4)
    qpos, out = batch.bind("qpos"), []
    for newtons in loads:
        batch.bind("qfrc_applied")[:, SLIP] = newtons
        batch.step(nstep=500)
        out.append(qpos[:, SLIP].copy())
    return np.array(out) + soft * np.array(loads)[:, None]


def test_stiffness_of_a_fixture_survives_the_round_trip():
    truth, loads = one("fixture_compliance", "fixture", z=3e-5), np.linspace(10, 50, 5)
    pressed = [depths([World(), truth], loads, arm) for arm in (1e-5, 2e-5)]

    def readings(r):
        rows = []
        for pose, both in enumerate(pressed):
            for ramp in (0, 1):
                depth = both + 2e-6 * r.standard_normal(both.shape)
                rows += [(f, depth[k, on], on, pose, ramp) for k, f in enumerate(loads) for on in (0, 1)]
        return dict(zip(("force", "depth", "on", "pose", "ramp"), np.array(rows).T, strict=True))

    found, _ = measured("stiffness", readings, {"z": 3e-5}, "--resolution", "force=0.01", "depth=1e-6")
    again = depths([truth, found], [25.0], 0.0)[0]
    assert again[1] == pytest.approx(again[0], abs=3 * 2e-6 * 25 / 30)


MASS, CENTRE = 1.2, np.array([0.01, -0.005, 0.06])


def attitudes(r, q):
    """A recording that holds still in each posture of q (n, nj), with the wrench of a ball that hangs at the flange."""
    robot = load("iiwa14")
    angles = np.repeat(q, 400, axis=0)
    quat = flange_pose(robot, angles)[:, 3:]
    down = np.empty((len(angles), 3))
    for k, way in enumerate(quat):
        mat = np.empty(9)
        mujoco.mju_quat2Mat(mat, way)
        down[k] = mat.reshape(3, 3).T @ [0.0, 0.0, -1.0]
    force = MASS * G * down
    wrench = np.hstack([force + [1.0, -2.0, 0.5], np.cross(CENTRE, force) + [0.1, 0.0, -0.2]])
    wrench += r.standard_normal(wrench.shape) * np.repeat([0.1, 0.005], 3)
    time = np.arange(len(angles)) / 500.0
    return Recording(Path("held"), "iiwa14", robot.joints, 500.0, Control("unknown", 500.0), time, angles, ft=wrench)


def held_torques(robot, q, payloads):
    """Torques (npayload, n, nj) N m that hold the arm with each payload in postures q (n, nj)."""
    out = []
    batch, _ = written([one("payload", "flange", **payload) for payload in payloads], robot)
    for row in range(len(payloads)):
        model, data = batch.get_model(row), batch.get_data(row)
        held = []
        for posture in q:
            data.qpos[:7], data.qvel[:] = posture, 0.0
            mujoco.mj_forward(model, data)
            held.append(data.qfrc_bias[:7].copy())
        out.append(held)
    return np.array(out)


@pytest.mark.parametrize("by", ["attitudes", "plumb lines"])
def test_a_centre_of_mass_survives_the_round_trip(by):
    robot = load("iiwa14")
    truth = {"mass": MASS, **dict(zip("xyz", CENTRE, strict=True))}
    if by == "attitudes":
        turns = [(0.0, 0.0), (0.9, 0.0), (-0.9, 1.2), (0.8, -1.2), (-0.5, 2.0)]
        q = np.array([[0.0, 0.5, 0.0, -1.2, 0.0, 0.9 + a, b] for a, b in turns])

        def held(r):
            write(attitudes(r, q), "held", overwrite=True)
            return ("held",)

        _, params = added("com", held, truth, "iiwa14", abs=2e-3)
    else:
        del truth["y"]  # along the photograph's axis

        def hung(r):
            weighed = MASS + 1e-4 * r.standard_normal(6)
            np.savetxt("m.csv", weighed, header="mass", comments="", fmt="%.6g")
            weigh = ["--resolution", "mass=1e-4", "--out", "mass.yaml", "--overwrite"]
            assert main(["measure", "mass", "m.csv", *weigh]) == 0
            x, z = np.array([0.0, 0.05, -0.03]), np.array([0.12, 0.02, -0.01])
            angle = np.arctan2(CENTRE[2] - z, CENTRE[0] - x) + 0.002 * r.standard_normal(3)
            return {"x": x, "y": z, "angle": angle}

        how = ["--mass", "mass.yaml", "--axes", "x", "z", "--resolution", "x=1e-4", "y=1e-4", "angle=0.01"]
        _, params = measured("com", hung, truth, *how, model="iiwa14", abs=2e-3)
    q = np.random.default_rng(1).uniform(-1.2, 1.2, (20, 7))
    worlds = [{"y": params["y"].value} | truth, {k: params[k].value for k in ("mass", "x", "y", "z")}]
    arm = held_torques(robot, q, [*worlds, {"mass": 0.0}])
    rms = [float(np.sqrt(np.mean((x - arm[0]) ** 2))) for x in arm[1:]]
    assert rms[0] < 0.02 * rms[1]
