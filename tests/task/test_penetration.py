"""How far the peg presses into the hole's wall in the task itself: arm, controller, contact and all."""

import mujoco
import numpy as np
import pytest

from vispeg.task.peg.task import PegInHoleVec

PUSH = 25.0  # N, as much as the controller itself may ask for
STATED = {3.0: 0.07, 1.0: 0.08, 0.5: 0.11, 0.2: 0.04}  # clearance in mm: depth in mm; docs/task.md states the greatest


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
    assert env.sim.tip_in_goal()[0, 2] < -0.01, "the peg is in the hole"
    sim, cell, data = env.sim, env.sim.cell, mujoco.MjData(env.sim.cell.model)
    depth, force = [], []
    cell.external[0] = [PUSH, 0.0, 0.0]
    for _ in range(200):  # ticks: the peg rattles, so that a few instants would be a matter of luck
        cell.read()
        cell.advance(sim.control.torque(*cell.measure(), sim.seen.goal, sim.seen.rot), sim.config.substeps)
        data.qpos[:] = cell.qpos[0]
        mujoco.mj_forward(cell.model, data)
        depth.append(-float(data.contact.dist.min(initial=0.0)))
        force.append(float(np.linalg.norm(cell.sensors[0, 7:10])))
    assert np.mean(force[-50:]) > 6.0, "the wall bears what the controller leaves of the push"
    assert 1e3 * max(depth) == pytest.approx(stated, abs=0.01)
