"""The state of a running batch that effects may read, and the model fields that they may write."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np


@dataclass
class DriveState:
    """The batch at one physics substep; all joint arrays are (nsim, nj), SI.

    Attributes:
        h: physics substep, s.
        tick: control period, s.
        q, dq, ddq: true link-side angle, velocity and acceleration, the latter of the last substep.
        tau: torque from the drive on the link in the last substep, N m.
        inertia: apparent inertia 1 / (M^-1)_jj, the least over the motion, kg m^2: the inertia that a stiff spring at
            the joint acts on.
        t: (nsim, 1) time on the recording's clock, s, negative while the arm rests before it; in a task, since the
            episode began.
    """

    h: float
    tick: float
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    tau: np.ndarray
    inertia: np.ndarray
    t: np.ndarray = field(default_factory=lambda: np.zeros((1, 1)))


class Fields:
    """Model fields for each simulation: `fields["body_mass"]` is (nsim, nbody), with nominal values until written.

    Attributes:
        model: the nominal MjModel.
        robot: the RobotModel, Scene or ObjectModel that it was made from.
        touched: names of the fields that were accessed.
        joints, dofs, qposes: joint ids, dof addresses and qpos addresses of the robot's joints, in its order.
        links: ids of the robot's moving bodies.
        flange: id of the flange's body, and the flange's position (3,) m and rotation (3, 3) in it; the world frame for
            a robot without a flange, such as a free object.
    """

    def __init__(self, batch: Any, robot: Any):
        self._batch, self.robot, self.model = batch, robot, batch.model
        self.touched: set[str] = set()
        self.joints, self.dofs, self.qposes, self.links, self.flange = _addresses(self.model, robot)

    def __getitem__(self, name: str) -> np.ndarray:
        self.touched.add(name)
        return self._batch.expand(name)


def _addresses(model: Any, robot: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[int], tuple]:
    """Return `joints`, `dofs`, `qposes`, `links` and `flange` of `Fields`."""
    joints = np.array([model.joint(j).id for j in robot.joints])
    dofs = np.array([model.joint(j).dofadr[0] for j in robot.joints])
    qposes = np.array([model.joint(j).qposadr[0] for j in robot.joints])
    links = [int(model.body(b).id) for b in robot.links]
    if not robot.flange:
        return joints, dofs, qposes, links, (0, np.zeros(3), np.eye(3))
    site, mat = model.site(robot.flange), np.empty(9)
    mujoco.mju_quat2Mat(mat, site.quat)
    return joints, dofs, qposes, links, (int(site.bodyid[0]), site.pos.copy(), mat.reshape(3, 3))


class RowFields:
    """Model fields of some rows, in place of a batch, for effects to write: `expand(name)` has shape (nrow, ...)."""

    def __init__(self, model: Any, nrow: int):
        self.model, self.nrow = model, nrow
        self.values: dict[str, np.ndarray] = {}

    def expand(self, name: str) -> np.ndarray:
        """Return a writable copy (nrow, ...) of the model's field: nominal values until an effect writes them."""
        if name not in self.values:
            owner = self.model.opt if name.startswith("opt.") else self.model
            value = np.asarray(getattr(owner, name.removeprefix("opt.")))
            self.values[name] = np.repeat(value[None], self.nrow, axis=0)
        return self.values[name]
