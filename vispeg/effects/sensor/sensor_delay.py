"""Sensor delay: encoder readings are `delay` old when the controller and the log get them.

MuJoCo's own mechanism is a sensor's `delay`; controllers here read angles, not sensors, so the ring buffer is kept
in the measurement chain. Between control ticks the past is interpolated linearly.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.delay import DelayLine


class SensorDelay(Effect):
    """Delay of joint readings."""

    name = "sensor_delay"
    family = "sensor"
    order = 90
    shared = True
    # a search tries `start`: 4 ms make a light joint under a stiff loop unstable, so that its signature says nothing
    params = {"delay": Param(0.0, 0.0, 0.03, "s", start=0.001, doc="age of a reading")}

    def start(self, x, p):
        longest = p["delay"].max(initial=0.0)
        return DelayLine(x.tick, longest), DelayLine(x.tick, longest)

    def observe(self, state, q, dq, x, p):
        return state[0](q, p["delay"]), state[1](dq, p["delay"])

    def regressor(self, look, p):
        return p["delay"] * look.rate(look.sent)  # a torque is logged with an older reading
