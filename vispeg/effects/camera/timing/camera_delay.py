"""Frame latency: what is delivered was seen `delay` seconds ago.

Of the frames that were rendered, the one nearest in time to `time - delay`, an earlier one where two are as near;
when an episode begins, its first. Cameras are exposed, read out and transferred in 20 to 120 ms, so a renderer that
gives frames far apart in time shows latency in whole steps only.

A delay below 0 is of recordings: the joint log's clock lags the camera's, so that a picture shows where the arm will be
read to be in a moment. A renderer has no later frame to give: it delivers the newest, and there the readings lag by the
effect `sensor_delay`.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import DELIVERED, CameraEffect
from vispeg.effects.common.field import begins


class CameraDelay(CameraEffect):
    """Delay of the camera's frames relative to the joint log."""

    name = "camera_delay"
    channel = "border"
    order = 85
    params = {
        "delay": Param(0.0, -0.1, 0.5, "s", start=0.06, doc="from exposure to arrival; below 0 the joint log lags")
    }

    def image(self, state, frame, p, rng):
        opening = begins(state, frame)
        past = state.setdefault("past", {})
        now = np.broadcast_to(np.asarray(frame.time, float), (frame.n,))
        for row in self.rows(p):
            row = int(row)
            history = [] if opening[row] else past.get(row, [])
            images = {n: i[row].copy() for n in DELIVERED if (i := getattr(frame, n)) is not None}
            history = [(t, i) for t, i in history if t >= now[row] - 2 * self.params["delay"].high] + [
                (now[row], images)
            ]
            past[row] = history
            ages = np.array([abs(t - (now[row] - p["delay"][row])) for t, _ in history])
            chosen = history[int(np.flatnonzero(ages <= ages.min() + 1e-9)[0])][1]
            for name, image in chosen.items():
                getattr(frame, name)[row] = image
