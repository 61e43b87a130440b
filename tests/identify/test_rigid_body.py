"""Inertia by inverse dynamics is that of the arm that rollouts simulate."""

import mujoco
import numpy as np
from mujoco import batch as mjb

from vispeg.core.effect import EffectInstance
from vispeg.identify.inverse import rigid_body
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.sim.nominal import dense
from vispeg.sim.physics import derive
from vispeg.sim.placement import activate
from vispeg.sim.state import Fields
from vispeg.worlds.world import World


def test_a_payload_is_as_hard_to_turn_as_a_ball_is():
    robot, q = load("iiwa14"), np.zeros((1, 7))
    world = World().add(EffectInstance.of("payload", "flange", mass=0.8, x=0.0, y=0.0, z=0.06, radius=0.03))
    added = rigid_body(robot, world, q, q)[0] - rigid_body(robot, World(), q, q)[0]
    assert abs(added[0, 6, 6] - 0.4 * 0.8 * 0.03**2) < 1e-9
    batch = mjb.Batch(compiled(robot), 1, nthread=1)
    fields = Fields(batch, robot)
    for a in activate(robot, [world]):
        a.effect.write(fields, a.p)
    derive(batch, fields)  # as a rollout does
    mass = batch.bind("M")
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
    driven = dense(compiled(robot), mass)[:, fields.dofs][:, :, fields.dofs]
    np.testing.assert_allclose(rigid_body(robot, world, q, q)[0], driven, atol=1e-12)
