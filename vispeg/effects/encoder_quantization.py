"""Encoder quantization: the measured angle is rounded to whole steps, `q = step round(q / step)`.

No MuJoCo mechanism, since it is the reading that is coarse. Source: Widrow and Kollar, Quantization Noise, eq. (1.1).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class EncoderQuantization(Effect):
    """A coarse encoder."""

    name = "encoder_quantization"
    kind = "drive"
    order = 95
    smooth = False
    params = {"step": Param(0.0, 0.0, 0.01, "rad", start=5e-4, doc="angle of one count")}

    def observe(self, state, q, dq, x, p):
        step = np.where(p["step"] > 0, p["step"], 1.0)
        return np.where(p["step"] > 0, np.round(q / step) * step, q), dq

    def guesses(self, look):
        """The spacing of the measured angles, where they are seen to lie on a grid wider than their noise."""
        values = np.unique(look.raw)
        gaps = np.diff(values)
        gaps = gaps[gaps > 1e-9]
        if len(gaps) < 4 or len(values) > 0.5 * len(look.raw):
            return [{"step": step} for step in self._from_noise(look)]
        return [{"step": float(np.clip(np.median(gaps), 1e-6, self.params["step"].high))}]

    def _from_noise(self, look):
        """Noise rides on the grid: the step whose phases cluster most (Rayleigh statistic over candidate steps)."""
        steps = np.geomspace(3e-5, 5e-3, 400)
        phase = np.abs([np.mean(np.exp(2j * np.pi * look.raw / s)) for s in steps])
        best = int(np.argmax(phase))
        return [float(steps[best])] if phase[best] > 0.3 else []
