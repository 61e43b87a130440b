"""The compiled nominal model behind every rollout, and the flange's path that follows from joint angles."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from vispeg.robots.model import RobotModel
from vispeg.sim.nominal import Nominal

_COMPILED: dict[int, mujoco.MjModel] = {}
_KEEP: list[RobotModel] = []  # ids stay unique while the robots live


def compiled(robot: RobotModel) -> mujoco.MjModel:
    """The robot's compiled model with the solver settings of rollouts; cached by the robot object."""
    key = id(robot)
    if key not in _COMPILED:
        model = robot.spec().compile()
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        _COMPILED[key] = model
        _KEEP.append(robot)
    return _COMPILED[key]


def columns(ids: Sequence[int]) -> slice | np.ndarray:
    """Ids as an index of array columns: a slice where they follow each other, which reads and writes without copies."""
    ids = np.asarray(ids, int)
    if len(ids) and np.array_equal(ids, np.arange(ids[0], ids[0] + len(ids))):
        return slice(int(ids[0]), int(ids[0]) + len(ids))
    return ids


def nominal_of(robot: RobotModel, nsim: int, nthread: int = 1) -> Nominal:
    """Nominal quantities of `nsim` arms at a time."""
    return Nominal(compiled(robot), robot.joints, robot.flange, nsim, nthread)


def flange_pose(robot: RobotModel, q: np.ndarray) -> np.ndarray:
    """Nominal flange pose (..., 7) x y z qw qx qy qz in the base for joint angles (..., nj)."""
    flat = q.reshape(-1, q.shape[-1])
    _, _, pos, rot, _ = nominal_of(robot, len(flat)).operational(np.nan_to_num(flat))
    return np.concatenate([pos, rot], axis=1).reshape(*q.shape[:-1], 7)
