"""Wrench bias: a constant is added to the reading of the wrist's force sensor, `w' = w + b`, in the flange frame.

Taring leaves it, or the sensor drifts. No MuJoCo mechanism, since it is the reading that is wrong. Source: the
affine model of a multi-axis force sensor, e.g. Traversaro et al. 2015, In situ calibration of six-axis force-torque
sensors.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.wrist import FORCE, TORQUE, WristEffect, axes


class WrenchBias(WristEffect):
    """Zero error of the wrist's wrench sensor."""

    name = "wrench_bias"
    order = 40
    params = {
        **{a: Param(0.0, -20.0, 20.0, "N", start=2.0, doc=f"measured minus true force along {a[1]}") for a in FORCE},
        **{a: Param(0.0, -2.0, 2.0, "N m", start=0.1, doc=f"measured minus true torque about {a[1]}") for a in TORQUE},
    }
    stage = "free air"
    sizes = {**dict.fromkeys(FORCE, (-1.0, 1.0)), **dict.fromkeys(TORQUE, (-0.1, 0.1))}
    shown_by = ("free",)
    told_from = {"tool_mass": "free", "tool_com": "free", "object_mass": "free"}
    needs = "free air"

    def wrench(self, state, wrench, x, p):
        return wrench + axes(p)

    def unread(self, reading, period, p):
        return reading - np.array([p[axis] for axis in (*FORCE, *TORQUE)])
