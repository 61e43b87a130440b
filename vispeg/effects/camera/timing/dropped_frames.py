"""Dropped frames: a lost frame is replaced by the last one that was delivered.

Each frame is lost with probability `chance`, independently; an episode's first frame is never lost. Range: 0 to 3 %.
"""

from __future__ import annotations

from vispeg.core.params import Param
from vispeg.effects.common.camera import DELIVERED, CameraEffect
from vispeg.effects.common.field import begins


class DroppedFrames(CameraEffect):
    """Lost camera frames."""

    name = "dropped_frames"
    order = 80
    random = True
    params = {"chance": Param(0.0, 0.0, 0.5, "1", start=0.02, doc="probability that a frame is lost")}

    def image(self, state, frame, p, rng):
        opening = begins(state, frame)
        last = state.setdefault("kept", {})
        for row in self.rows(p):
            row = int(row)
            if rng[row].random() < p["chance"][row] and not opening[row] and row in last:
                for name, image in last[row].items():
                    getattr(frame, name)[row] = image
            else:
                last[row] = {n: i[row].copy() for n in DELIVERED if (i := getattr(frame, n)) is not None}
