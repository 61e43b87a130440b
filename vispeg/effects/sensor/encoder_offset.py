"""Encoder offset: the measured angle is the true one plus a constant (a zero that was set wrong).

The controller and the log read the shifted angle while the arm is elsewhere, so gravity and kinematics do not match.
Its sign is measured minus true. No MuJoCo mechanism, since it is the reading that is wrong.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class EncoderOffset(Effect):
    """Constant error of the measured angle."""

    name = "encoder_offset"
    family = "sensor"
    order = 20
    told_from = {"camera_offset": "the fixture seen with the wrist joints turned both ways"}
    params = {"offset": Param(0.0, -0.2, 0.2, "rad", start=0.01, doc="measured minus true angle")}

    def channels(self):
        return super().channels() | {"border"}  # borders of parts in pictures, predicted from the measured angles

    def observe(self, state, q, dq, x, p):
        return q + p["offset"], dq

    def regressor(self, look, p):
        true_minus_measured = np.broadcast_to(-p["offset"], look.sent.shape)
        return look.moved(true_minus_measured)
