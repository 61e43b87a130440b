"""Joint stops that a robot's model states and its motion denies."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from vispeg.core.rules import RULES
from vispeg.robots.model import RobotModel


def passed(robot: RobotModel, q: np.ndarray) -> tuple[str, ...]:
    """Joints that were measured at angles q (n, nj), rad, which the model's stops would not let them reach."""
    low, high = robot.range.T
    outside = (q < low - RULES.beyond_stop) | (q > high + RULES.beyond_stop)  # a missing reading is no angle
    return tuple(j for j, out in zip(robot.joints, outside.any(axis=0), strict=True) if out)


def without_stops(robot: RobotModel, joints: tuple[str, ...]) -> RobotModel:
    """Give the robot without stops in these joints; its `range`, which is what motions are planned for, stays."""

    def build() -> mujoco.MjSpec:
        spec = robot.build()
        for name in joints:
            spec.joint(name).limited = mujoco.mjtLimited.mjLIMITED_FALSE
        return spec

    return replace(robot, build=build) if joints else robot
