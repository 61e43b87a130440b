"""Frame latency: the delivered frame was taken `delay` seconds ago.

Of the rendered frames, the one nearest in time to `time - delay` is delivered; of two equally near ones, the earlier.
When an episode begins, that is its first frame. Exposure, read-out and transfer take 20 to 120 ms. If frames are
rendered further apart in time, the latency is a whole number of frames.

A delay below 0 occurs in recordings: the joint log's clock lags the camera's, so an image shows a pose that the log
reaches only later. In simulation there is no later frame, so the newest is delivered; use `sensor_delay` there to make
the joint readings late.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import DELIVERED, LOOK_FAST, CameraEffect
from vispeg.effects.common.field import begins


class CameraDelay(CameraEffect):
    """Delay of the camera's frames relative to the joint log."""

    name = "camera_delay"
    channel = "border"
    order = 85
    shown_by = (LOOK_FAST,)
    told_from = {
        "camera_offset": "the same path both ways, at two speeds",
        "encoder_offset": "the same path both ways, at two speeds",
        "rolling_shutter": LOOK_FAST,
    }
    params = {
        "delay": Param(0.0, -0.1, 0.5, "s", start=0.06, doc="from exposure to arrival; below 0 the joint log lags")
    }

    def image(self, state, frame, p, rng):
        opening = begins(state, frame)
        past = state.setdefault("past", {})
        now = np.broadcast_to(np.asarray(frame.time, float), (frame.n,))
        for row in self.rows(p):
            row = int(row)
            history = [] if opening[row] else past.get(row, [])  # (time in s, images by field), oldest first
            images = {n: i[row].copy() for n in DELIVERED if (i := getattr(frame, n)) is not None}
            oldest = now[row] - 2 * self.params["delay"].high
            history = [(t, i) for t, i in history if t >= oldest] + [(now[row], images)]
            past[row] = history
            apart = np.array([abs(t - (now[row] - p["delay"][row])) for t, _ in history])
            chosen = history[int(np.flatnonzero(apart <= apart.min() + 1e-9)[0])][1]
            for name, image in chosen.items():
                getattr(frame, name)[row] = image
