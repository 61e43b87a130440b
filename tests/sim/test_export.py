"""An exported MJCF moves in plain MuJoCo as the plant does, and says which effects it could not hold."""

import mujoco
import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, searchable
from vispeg.robots.model import load
from vispeg.sim.export import MOTOR, STEP, compiled_with, is_native, to_mjcf
from vispeg.sim.plant import Plant
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
Q0 = np.array([0.1, 0.5, -0.2, -1.2, 0.3, 0.9, 0.0])


def written(world, folder):
    made = to_mjcf(world)
    for name, file in made.meshes.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(file.read_bytes())
    (folder / "arm.xml").write_text(made.xml)
    return mujoco.MjModel.from_xml_path(str(folder / "arm.xml")), made


def torques(n):
    t = STEP * np.arange(n)[:, None]
    return np.array([4, 12, 4, 8, 2, 1.5, 0.4]) * np.sin(2 * np.pi * (0.7 + 0.2 * np.arange(7)) * t + np.arange(7))


def plain(model, n):
    """Joint angles of MuJoCo alone under the torques, (n, nj)."""
    data = mujoco.MjData(model)
    data.qpos[:] = Q0
    out = []
    for u in torques(n):
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        out.append(data.qpos.copy())
    return np.array(out)


def ours(world, n):
    """The same of the plant, whose batch is stepped with the torques that the effects make of the commands."""
    plant = Plant(ROBOT, [world], STEP, STEP, 1)
    plant.start(Q0[None], np.zeros((1, 7)), np.zeros((1, 7)), np.ones((1, 7)))
    out = []
    for u in torques(n):
        plant.read()
        plant.ctrl[:, plant.u] = plant.forces(u[None]).drive
        plant.batch.step()
        out.append(plant.qpos[0, plant.qadr].copy())
    return np.array(out)


def big(name):
    kind = searchable()[name]
    where = kind.targets(ROBOT)[min(3, len(kind.targets(ROBOT)) - 1)]
    sizes = {k: p.start for k, p in kind.params.items()} | ({"limit": 3.0} if name == "torque_limit" else {})
    return EffectInstance.of(name, where, **sizes)


NATIVE = sorted(n for n, e in searchable().items() if is_native(e))


def test_what_is_native():
    assert {"coulomb_friction", "viscous_friction", "payload", "link_mass", "rotor_inertia", *MOTOR} <= set(NATIVE)
    assert not {"stribeck_friction", "backlash", "encoder_offset", "actuator_lag"} & set(NATIVE)


@pytest.mark.parametrize("name", NATIVE)
def test_plain_mujoco_moves_as_the_plant_does(name, tmp_path):
    world = World("iiwa14").add(big(name))
    model, made = written(world, tmp_path)
    assert made.native == world.effects and made.left_out == ()
    found, expected = plain(model, 300), ours(world, 300)
    moved = np.abs(expected - plain(written(World("iiwa14"), tmp_path)[0], 300)).max()
    assert moved > 1e-5, "the effect changes the motion"
    assert np.abs(found - expected).max() < 1e-3 * moved + 1e-9


def test_gain_bias_and_limit_of_one_motor_follow_the_drive_chain(tmp_path):
    effects = [
        EffectInstance.of("torque_gain", "joint4", gain=1.4),
        EffectInstance.of("joint_bias", "joint4", torque=2),
    ]
    world = World("iiwa14").add(*effects, EffectInstance.of("torque_limit", "joint4", limit=5.0))
    model, _ = written(world, tmp_path)
    assert np.allclose(plain(model, 300), ours(world, 300), atol=1e-9)


def test_what_cannot_be_held_is_named(tmp_path):
    world = World("iiwa14").add(big("payload"), big("stribeck_friction"), big("encoder_offset"))
    _, made = written(world, tmp_path)
    assert [e.effect for e in made.native] == ["payload"]
    assert [e.effect for e in made.left_out] == ["stribeck_friction", "encoder_offset"]
    assert "/work" not in made.xml and str(ROBOT.source) not in made.xml


def test_the_model_of_the_viewer_is_the_one_that_is_written(tmp_path):
    world = World("iiwa14").add(big("coulomb_friction"), big("backlash"))
    shown, left_out = compiled_with(world)
    model, _ = written(world, tmp_path)
    assert [e.effect for e in left_out] == ["backlash"] and shown.nv == model.nv
    assert np.array_equal(shown.dof_frictionloss, model.dof_frictionloss) and shown.dof_frictionloss.any()
