"""Servo: the bandwidth w, damping ratio zeta and static gain K of the control loop inside a position servo.

`tau = J (w^2 (K goal - q) - 2 zeta w dq)`, where J is the nominal arm's apparent inertia at the joint, averaged over
its postures. At null the servo follows its goal almost at once (w = 150 rad/s, zeta 1, K 1). MuJoCo's own mechanism is
a `position` actuator with gains fixed when the model is compiled; here each simulation has its own. Source: Franklin,
Powell and Emami-Naeini, Feedback Control of Dynamic Systems, 7th ed., sec. 3.3, eq. (3.55).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.servo_loop import FAST


class Servo(Effect):
    """Closed loop of a position servo: second order, with a static gain."""

    name = "servo"
    family = "drive"
    common = "servo"
    telling = ("natural_frequency",)
    params = {
        "natural_frequency": Param(
            FAST, 2.0, FAST, "rad/s", start=25.0, scale="log", doc="bandwidth at the joint's nominal inertia"
        ),
        "damping_ratio": Param(1.0, 0.1, 4.0, "1", start=0.8, shape=True, scale="log", doc="damping ratio"),
        "gain": Param(1.0, 0.8, 1.2, "1", start=0.98, doc="angle reached over goal, without load"),
    }

    def regulate(self, loop, p):
        slow = p["natural_frequency"] < FAST
        loop.frequency = np.minimum(p["natural_frequency"], FAST)
        loop.damping = np.where(slow, p["damping_ratio"], loop.damping)
        loop.gain = loop.gain * p["gain"]

    def guesses(self, look):
        return [{"natural_frequency": w, "damping_ratio": z} for w in (10.0, 25.0, 60.0) for z in (0.5, 1.2)]
