"""Command delay: the torque, or the goal of a position servo, acts `delay` after it was sent (bus cycle, firmware).

MuJoCo's own mechanism, an actuator's `delay`, reads its history before it writes to it, so any delay below one step
becomes a whole step. Training draws 0 to 20 ms at steps of 1.7 ms: a twelfth of its delays would be wrong. The ring
buffer here is exact for any delay; interpolation over a physics step gives the step's mean torque.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.delay import DelayLine


class CommandDelay(Effect):
    """Dead time between a command and its effect."""

    name = "command_delay"
    family = "drive"
    commanded = True
    order = 10
    shared = True
    # a search tries `start`: 4 ms make a light joint under a stiff loop unstable, so that its signature says nothing
    params = {"delay": Param(0.0, 0.0, 0.03, "s", start=0.001, doc="dead time")}

    def start(self, x, p):
        return DelayLine(x.h, p["delay"].max(initial=0.0))

    def drive(self, state, tau, x, p):
        return state(tau, p["delay"])

    def regressor(self, look, p):
        return p["delay"] * look.rate(look.sent)  # tau(t) = sent(t - delay)

    def goal(self, state, goal, x, p):
        return state(goal, p["delay"])
