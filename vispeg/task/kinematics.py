"""An arm's kinematics and its tool's weight as its controller knows them, as numbers without MuJoCo."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np

from vispeg.interface.chain import Chain
from vispeg.robots.model import RobotModel
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled


@lru_cache(maxsize=64)
def chain_of(robot: RobotModel) -> Chain:
    """Return the kinematic chain of the nominal arm from base to flange, which needs no MuJoCo."""
    model = compiled(robot)
    order = {int(model.joint(name).id): i for i, name in enumerate(robot.joints)}  # MuJoCo's id -> index in q
    site = model.site(robot.flange).id
    bodies = [int(model.site_bodyid[site])]
    while model.body_parentid[bodies[0]] > 0:
        bodies.insert(0, int(model.body_parentid[bodies[0]]))
    turn, pos, rows = np.eye(3), np.zeros(3), []  # turn, pos: pose in the frame of the last joint, or in the world
    for body in bodies:
        pos, turn = pos + turn @ model.body_pos[body], turn @ _matrix(model.body_quat[body])
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            if joint in order:
                zero = model.qpos0[model.jnt_qposadr[joint]]
                rows.append((turn, pos, model.jnt_pos[joint].copy(), model.jnt_axis[joint].copy(), zero, order[joint]))
                turn, pos = np.eye(3), np.zeros(3)
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    turns, places, anchors, axes, zeros, numbers = columns
    end_turn, end_pos = turn @ _matrix(model.site_quat[site]), pos + turn @ model.site_pos[site]
    return Chain(turns, places, anchors, axes, zeros, numbers, end_turn, end_pos)


def _matrix(quat: np.ndarray) -> np.ndarray:
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, quat)
    return out.reshape(3, 3)


def tool_weight(scene: Scene) -> np.ndarray:
    """Return the nominal weight (3,) N, world frame, of tool and held part, which the wrench sensor carries at rest."""
    model = scene.nominal.compile()
    tool = [b for b in range(model.nbody) if model.body(b).name in ("tool", scene.held)]
    return float(model.body_mass[tool].sum()) * model.opt.gravity
