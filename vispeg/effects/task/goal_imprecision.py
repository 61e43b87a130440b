"""Goal imprecision: the believed position of the hole is off by (x, y, z), base axes.

The physics does not change, only what the task tells a policy. Source: Kaspar and Bock, Reinforcement Learning with
Cartesian Commands and Sim to Real Transfer for Peg in Hole Tasks, whose policies learnt a subtler search from it.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common import parts


class GoalImprecision(Effect):
    """Error of the believed hole position."""

    name = "goal_imprecision"
    family = "task"
    params = {
        axis: Param(0.0, -0.05, 0.05, "m", start=0.002, doc=f"believed minus true {axis}, base axes") for axis in "xyz"
    }

    def targets(self, model):
        return parts.goal(model)

    def believe(self, goal, p):
        return goal + np.stack([p[axis][:, 0] for axis in "xyz"], axis=1)
