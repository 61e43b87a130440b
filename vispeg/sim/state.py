"""What effects may read of a running batch, and the model fields they may write."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np


@dataclass
class DriveState:
    """The batch at one physics substep; all joint arrays are (nsim, nj), SI.

    Attributes:
        h: physics substep, s.
        tick: control period, s.
        q, dq, ddq: true link-side angle, velocity and (last substep's) acceleration.
        tau: torque the drive handed to the link in the last substep, N m.
        inertia: apparent inertia 1 / (M^-1)_jj, the least over the motion, kg m^2: what a stiff spring at the joint
        feels.
    """

    h: float
    tick: float
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    tau: np.ndarray
    inertia: np.ndarray


class Fields:
    """Per-simulation model fields: `fields["body_mass"]` is (nsim, nbody), nominal until written.

    Attributes:
        model: the nominal MjModel.
        robot: the RobotModel, Scene or ObjectModel that it was made from.
        touched: names of the fields asked for.
        joints, dofs, qposes: ids of the robot's joints, in its order.
        links: ids of its moving bodies.
        flange: id of the body that carries the flange, and the flange's position (3,) and rotation (3, 3) in it; of a
            free object its world.
    """

    def __init__(self, batch: Any, robot: Any):
        self._batch, self.robot = batch, robot
        model = self.model = batch.model
        self.touched: set[str] = set()
        self.joints = np.array([model.joint(j).id for j in robot.joints])
        self.dofs = np.array([model.joint(j).dofadr[0] for j in robot.joints])
        self.qposes = np.array([model.joint(j).qposadr[0] for j in robot.joints])
        self.links = [int(model.body(b).id) for b in robot.links]
        self.flange = 0, np.zeros(3), np.eye(3)
        if not robot.flange:
            return
        site = model.site(robot.flange)
        mat = np.empty(9)
        mujoco.mju_quat2Mat(mat, site.quat)
        self.flange = int(site.bodyid[0]), site.pos.copy(), mat.reshape(3, 3)

    def __getitem__(self, name: str) -> np.ndarray:
        self.touched.add(name)
        return self._batch.expand(name)
