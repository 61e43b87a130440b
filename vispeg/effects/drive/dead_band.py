"""Dead band: a position servo makes no torque for an error below `width / 2`, so that it does not hum at rest.

The error counts only beyond the band: `e -> e - clip(e, +-width / 2)`. Source: the dead-zone of Slotine and Li, Applied
Nonlinear Control, 1991, sec. 5.2; servo makers set it in steps of the encoder.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class DeadBand(Effect):
    """Dead band of a servo: smaller errors have no effect."""

    name = "dead_band"
    family = "drive"
    smooth = False
    params = {"width": Param(0.0, 0.0, 0.1, "rad", start=0.01, doc="total width about the goal")}

    def regulate(self, loop, p):
        loop.band = loop.band + 0.5 * p["width"]
