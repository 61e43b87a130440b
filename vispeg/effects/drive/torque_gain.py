"""Torque gain: the drive delivers `gain` times the torque it is asked for (torque constant, calibration, gear loss).

MuJoCo's own mechanism is `gear`/`gainprm`; the product is taken in the drive chain, before bias and limits, here.
Source: De Luca and Albu-Schaeffer's drive-gain calibration, e.g. Gautier and Briot, ICRA 2014, eq. (1).
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class TorqueGain(Effect):
    """Gain error of the commanded torque."""

    name = "torque_gain"
    family = "drive"
    commanded = True
    order = 30
    params = {"gain": Param(1.0, 0.5, 1.5, "1", start=1.05, doc="delivered over commanded torque")}

    def channels(self):
        return super().channels() - {"servo", "load"}  # it only scales the unknown stiffness of the servo's loop

    def drive(self, state, tau, x, p):
        return tau * p["gain"]

    def inverse(self, needed, sensor, p):
        # behind the gear, the gain stands for a scale error of the sensor; else the command makes up for the gain
        return needed * p["gain"] if sensor == "joint" else needed / p["gain"]
