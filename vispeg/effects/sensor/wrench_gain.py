"""Wrench gain: the wrist's force sensor reads all six components scaled by one factor, `w' = gain w`.

The tool's weight is scaled too, while the task subtracts the declared weight. No MuJoCo mechanism, since it is the
reading that is wrong. Source: the affine model of a multi-axis force sensor, e.g. Traversaro et al.
2015, In situ calibration of six-axis force-torque sensors, with a multiple of the identity as its matrix.
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects.common.wrist import WristEffect


class WrenchGain(WristEffect):
    """Scale error of the wrist's wrench sensor."""

    name = "wrench_gain"
    order = 30
    params = {"gain": Param(1.0, 0.2, 2.0, "1", start=1.1, doc="measured over true wrench")}
    stage = "free air"
    sizes = {"gain": (0.8, 0.93, 1.07, 1.25)}
    shown_by = ("free", "hard-press")
    told_from = {"tool_mass": "free"}
    needs = "two forces"

    def wrench(self, state, wrench, x, p):
        return p["gain"] * wrench

    def unread(self, reading, period, p):
        return reading / p["gain"]
