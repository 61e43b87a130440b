"""Goal rate limit: the goal g that a servo's loop follows moves to the commanded goal at no more than `rate`.

`g <- g + clip(goal - g, +-rate h)` at each step h: a trapezoidal profile without its ramps of acceleration. MuJoCo has
no mechanism for it. Source: Slotine and Li, Applied Nonlinear Control, 1991, sec. 5.2 (rate saturation).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class GoalRateLimit(Effect):
    """Rate limit of a servo's goal."""

    name = "goal_rate_limit"
    family = "drive"
    order = 20
    smooth = False
    params = {"rate": Param(1000.0, 0.05, 1000.0, "rad/s", start=1.0, scale="log", doc="greatest speed of the goal")}

    def start(self, x, p):
        return {"goal": np.full_like(x.q, np.nan)}  # at the first goal, the servo is at rest there

    def goal(self, state, goal, x, p):
        before = np.where(np.isnan(state["goal"]), goal, state["goal"])
        reach = p["rate"] * x.h
        near = np.abs(goal - before) <= reach
        state["goal"] = np.where(near, goal, before + np.clip(goal - before, -reach, reach))
        return np.where(p["rate"] < self.params["rate"].null, state["goal"], goal)

    def guesses(self, look):
        """Return the highest speeds of the joint: a limited servo reaches its rate and does not exceed it."""
        top = np.quantile(np.abs(look.dq), (0.999, 0.98, 0.9))
        low, null = self.params["rate"].low, self.params["rate"].null
        return [{"rate": float(np.clip(v, low, null - 1.0))} for v in np.unique(top)]
