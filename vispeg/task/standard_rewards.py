"""Reward terms for any task whose tip has a goal. Each is at least 0, and 0 is best: give them negative weights."""

from __future__ import annotations

import numpy as np

from vispeg.task.rewards import Moment, RewardTerm

L0, F0 = 0.002, 40.0  # m and N: scales of the lateral distance and of the force


def _distance(m: Moment) -> np.ndarray:
    return np.linalg.norm(m.tip - m.goal, axis=1) / m.scale


def _axis(m: Moment) -> np.ndarray:
    lateral = np.hypot(m.tip[:, 0], m.tip[:, 1])
    return 1.0 - np.exp(-0.5 * (lateral / L0) ** 2)


def _force(m: Moment) -> np.ndarray:
    return np.minimum(m.force / F0, 3.0) ** 2


def _euclidean(m: Moment) -> np.ndarray:
    return np.linalg.norm(m.goal - m.tip, axis=1)


def _manhattan(m: Moment) -> np.ndarray:
    return np.abs(m.goal - m.tip).sum(axis=1)


def _action(m: Moment) -> np.ndarray:
    return np.square(m.action).sum(axis=1)


DISTANCE = RewardTerm("distance", _distance, "from the tip to its goal over the task's reward_scale")
AXIS = RewardTerm("axis", _axis, "1 - exp(-(l / 2 mm)^2 / 2), l the tip's distance from the goal's axis")
FORCE = RewardTerm("force", _force, "(F / 40 N)^2, F the step's largest contact force up to 120 N")
EUCLIDEAN = RewardTerm("euclidean", _euclidean, "distance from the tip to its goal, m")
MANHATTAN = RewardTerm("manhattan", _manhattan, "sum of the distances along the goal's axes, m")
ACTION = RewardTerm("action", _action, "sum of squares of the action's entries, each within +-1")
STANDARD = (DISTANCE, AXIS, FORCE, EUCLIDEAN, MANHATTAN, ACTION)
