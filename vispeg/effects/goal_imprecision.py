"""Goal imprecision: the hole is believed (x, y, z) from where it is, base axes.

The physics does not change, what the task tells a policy does. Source: Kaspar, Munoz Osorio and Bock 2020, who train
with an imprecise goal so that a policy learns to search for the hole.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects._parts import in_scene


class GoalImprecision(Effect):
    """A belief of the hole's place that is off."""

    name = "goal_imprecision"
    kind = "contact"
    params = {
        axis: Param(0.0, -0.05, 0.05, "m", start=0.002, doc=f"believed minus true {axis}, base axes") for axis in "xyz"
    }

    def targets(self, model):
        return in_scene(model, "hole")

    def believe(self, goal, p):
        return goal + np.stack([p[axis][:, 0] for axis in "xyz"], axis=1)
