"""How far the peg presses into the hole's wall in the task itself: arm, controller, contact and all."""

import mujoco
import numpy as np
import pytest

from vispeg.task.vector import PegInHoleVec

PUSH = 25.0  # N, as much as the controller itself may ask for
STATED = {3.0: 0.045, 1.0: 0.041, 0.5: 0.043, 0.2: 0.054}  # clearance in mm: depth in mm, as docs/task.md has it


@pytest.mark.parametrize(("clearance", "stated"), STATED.items())
def test_a_pushed_peg_presses_as_deep_into_the_wall_as_stated(clearance, stated):
    env = PegInHoleVec(
        1,
        world="nominal",
        autoreset_mode="Disabled",
        clearance_mm=clearance,
        start_radius=0.0,
        start_height=(0.003, 0.003),
        success_depth=1.0,
    )
    env.reset(seed=[0])
    for _ in range(6):
        env.step(np.array([[0.0, 0.0, -0.4]]))
    assert env.sim.tip_in_hole()[0, 2] < -0.01, "the peg is in the hole"
    env.push([0], [PUSH, 0.0, 0.0], 0.0, 100.0)
    data, depth, force = mujoco.MjData(env.sim.cell.model), [], []
    for _ in range(6):
        env.step(np.zeros((1, 3)))
        data.qpos[:] = env.sim.cell.qpos[0]
        mujoco.mj_forward(env.sim.cell.model, data)
        depth.append(-float(data.contact.dist.min(initial=0.0)))
        force.append(float(env.sim.tracks[0].forces[-1].max()))
    assert max(force) > 15.0, "the wall bears the push"
    assert 1e3 * max(depth) == pytest.approx(stated, abs=0.001)
