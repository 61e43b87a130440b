"""Torque gain: the drive delivers `gain` times the torque it is asked for (torque constant, calibration, gear loss).

`tau = gain tau_cmd`. MuJoCo's own mechanism is an actuator's `gear` or `gainprm`, fixed when the model is compiled;
here each simulation has its own gain, which acts before the limits and the bias. Source: the calibration of drive
gains, Gautier and Briot, ICRA 2014, eq. (1).
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class TorqueGain(Effect):
    """Gain error of the commanded torque."""

    name = "torque_gain"
    family = "drive"
    commanded = True  # the torque depends on the command alone, not on the arm's motion
    order = 30  # after delay (10) and lag (15), before limit (40) and bias (45)
    params = {"gain": Param(1.0, 0.5, 1.5, "1", start=1.05, doc="delivered over commanded torque")}

    def channels(self):
        # under a servo's own loop it would act like another gain of the loop, which is unknown and fitted anyway
        return super().channels() - {"servo", "load"}

    def drive(self, state, tau, x, p):
        return tau * p["gain"]

    def inverse(self, needed, sensor, p):
        if sensor == "joint":  # it does not see the drive's gain: what `gain` stands for here is its own wrong scale
            return needed * p["gain"]
        return needed / p["gain"]  # the reading is that of the command, to which the drive applies the gain
