"""A part that is held below what its grip holds stays where it is, and one that slips does as before."""

import mujoco
import numpy as np
import pytest
from mujoco import batch as mjb
from pressed import SCENE

from vispeg.sim.physics import firm

STEP, TIME = 5e-4, 0.3


def speed(force: float, firmly: bool) -> float:
    """m/s along the gripper in the second half of a push, with an arm that gives way hardly."""
    model = SCENE.compile()
    joint = model.joint(SCENE.slip)
    slide, at = int(joint.dofadr[0]), int(joint.qposadr[0])
    others = np.arange(model.nv) != slide
    model.dof_armature[others], model.dof_damping[others] = 30.0, 1e3
    mujoco.mj_setConst(model, mujoco.MjData(model))
    batch = mjb.Batch(model, 1, nthread=1)
    batch.expand("opt.timestep")[:] = STEP
    if firmly:
        firm(batch, model, SCENE.slip)
    place, push, weight = batch.bind("qpos"), batch.bind("qfrc_applied"), batch.bind("qfrc_bias")
    batch.forward()
    way = []
    for _ in range(round(TIME / STEP)):
        push[:] = weight
        push[0, slide] += force
        batch.step()
        way.append(place[0, at])
    half = len(way) // 2
    return (way[-1] - way[half]) / (STEP * (len(way) - 1 - half))


@pytest.mark.parametrize("force", [25.0, 60.0, 115.0])
def test_a_grip_that_holds_does_not_creep(force):
    assert speed(force, firmly=False) > 1.5e-5, "which MuJoCo's friction does"
    assert abs(speed(force, firmly=True)) < 2e-8 * force


@pytest.mark.parametrize("force", [122.0, 150.0])
def test_what_slips_slips_as_before(force):
    free, held = speed(force, firmly=False), speed(force, firmly=True)
    assert free > 0.01 and held == pytest.approx(free, rel=1e-3)
