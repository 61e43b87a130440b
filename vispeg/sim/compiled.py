"""The compiled nominal model behind every rollout, and the flange's path that follows from joint angles."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache

import mujoco
import numpy as np

from vispeg.core.effect import effect
from vispeg.robots.model import RobotModel
from vispeg.sim.nominal import Nominal

BATCH = 4096  # greatest number of postures in one batch: MuJoCo's state of each takes kilobytes


def compiled(robot: RobotModel, parts: Iterable[str] = ()) -> mujoco.MjModel:
    """Return the robot's compiled model with the solver settings of rollouts, cached for recently used robots.

    `parts` are names of effects; the elements that some of them add are part of the model.
    """
    return _compiled(robot, tuple(sorted({name for name in parts if effect(name).overrides("build")})))


@lru_cache(maxsize=64)  # robots are hashed by identity
def _compiled(robot: RobotModel, built: tuple[str, ...]) -> mujoco.MjModel:
    spec = robot.spec()
    for name in built:
        effect(name).build(spec, robot)
    model = spec.compile()
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    model.opt.disableflags |= idle(model)
    return model


def idle(model: mujoco.MjModel) -> int:
    """Return the flags that disable features which cannot change this model's motion.

    This saves a sixth of the time of an arm's step.
    """
    flags, disable = 0, mujoco.mjtDisableBit
    if not np.any(model.geom_contype[:, None] & model.geom_conaffinity) and model.npair == 0:
        flags |= int(disable.mjDSBL_CONTACT)
    if model.ntree < 2:  # one kinematic tree is one island
        flags |= int(disable.mjDSBL_ISLAND)
    return flags


def nominal_of(robot: RobotModel, nsim: int, nthread: int = 1) -> Nominal:
    """Make the evaluator of nominal quantities for `nsim` postures at a time."""
    return Nominal(compiled(robot), robot.joints, robot.flange, nsim, nthread)


def of_postures(robot: RobotModel, q: np.ndarray, get: Callable[[Nominal, np.ndarray], np.ndarray]) -> np.ndarray:
    """Evaluate `get(nominal, q)` for postures q (n, nj) in blocks, to save memory; rows are independent."""
    parts = [q[start : start + BATCH] for start in range(0, max(1, len(q)), BATCH)]
    return np.concatenate([get(nominal_of(robot, len(part)), part) for part in parts])


def flange_pose(robot: RobotModel, q: np.ndarray) -> np.ndarray:
    """Compute the nominal flange pose (..., 7) x y z qw qx qy qz in the base for joint angles (..., nj)."""
    flat = np.nan_to_num(q.reshape(-1, q.shape[-1]))
    pose = of_postures(robot, flat, lambda nominal, block: np.concatenate(nominal.operational(block)[2:4], axis=1))
    return pose.reshape(*q.shape[:-1], 7)
