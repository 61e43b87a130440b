"""Wrench delay: the wrist's force sensor reads the wrench of `delay` ago.

Filters and buses of a force sensor, as a pure dead time: w'(t) = w(t - delay). Readings are taken at control ticks;
between them the past is interpolated linearly. MuJoCo's own mechanism is a sensor's `delay`; as in `sensor_delay` a
ring buffer in the measurement chain is used, where each simulation has a delay of its own.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.delay import DelayLine
from vispeg.effects.common.wrist import WristEffect


class WrenchDelay(WristEffect):
    """Delay of wrench readings."""

    name = "wrench_delay"
    order = 20
    params = {"delay": Param(0.0, 0.0, 0.2, "s", start=0.01, doc="age of a reading")}
    stage = "free air"
    sizes = {"delay": (0.006, 0.02, 0.05)}
    shown_by = ("tap", "free")

    def start(self, x, p):
        return DelayLine(x.tick, p["delay"].max(initial=0.0))

    def wrench(self, state, wrench, x, p):
        return state(wrench, np.broadcast_to(p["delay"], wrench.shape))

    def unread(self, reading, period, p):
        time = period * np.arange(len(reading))
        return np.stack([np.interp(time + p["delay"], time, v) for v in reading.T], axis=1)
