"""Leave out joint stops of a robot's model that its measured motion passes: the robot cannot have them there."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import mujoco
import numpy as np

from vispeg.core.rules import RULES
from vispeg.robots.model import RobotModel


def passed(robot: RobotModel, q: np.ndarray) -> tuple[str, ...]:
    """Return the joints measured at angles q (n, nj) rad beyond their model's stops."""
    low, high = robot.range.T
    outside = (q < low - RULES.beyond_stop) | (q > high + RULES.beyond_stop)  # false for missing readings
    return tuple(j for j, out in zip(robot.joints, outside.any(axis=0), strict=True) if out)


@lru_cache(maxsize=64)  # robots are hashed by identity
def without_stops(robot: RobotModel, joints: tuple[str, ...]) -> RobotModel:
    """Return the robot without stops in these joints; its `range`, used for planning motions, stays.

    The same arguments return the same object.
    """

    def build() -> mujoco.MjSpec:
        spec = robot.build()
        for name in joints:
            spec.joint(name).limited = mujoco.mjtLimited.mjLIMITED_FALSE
        return spec

    return replace(robot, build=build) if joints else robot
