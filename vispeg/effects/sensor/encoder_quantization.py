"""Encoder quantization: the measured angle is rounded to whole steps, `q = step round(q / step)`.

No MuJoCo mechanism, since it is the reading that is coarse. Source: Widrow and Kollar, Quantization Noise, eq. (1.1).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class EncoderQuantization(Effect):
    """Quantization of the measured angle."""

    name = "encoder_quantization"
    family = "sensor"
    order = 95
    smooth = False
    torqueless = True
    params = {"step": Param(0.0, 0.0, 0.01, "rad", start=5e-4, doc="angle of one count")}

    def observe(self, state, q, dq, x, p):
        step = np.where(p["step"] > 0, p["step"], 1.0)
        return np.where(p["step"] > 0, np.round(q / step) * step, q), dq

    def resolution(self, p):
        return float(p["step"])

    def reading_noise(self, sigma, p):
        """Return the RMS change of a reading by noise, sqrt(E[(Q(x + n) - Q(x))^2]) with n ~ N(0, sigma^2), Q rounding.

        For x uniform in its step and n = (m + f) step, the reading changes by m steps, or by m + 1 with probability f.
        """
        if not p["step"] > 0 or not sigma > 0:
            return sigma
        n = np.linspace(-6, 6, 4001) * sigma
        weight = np.exp(-0.5 * (n / sigma) ** 2)
        steps, part = np.divmod(n / p["step"], 1.0)
        squared = (1 - part) * steps**2 + part * (steps + 1) ** 2
        return float(p["step"] * np.sqrt(np.average(squared, weights=weight)))

    def guesses(self, look):
        """Return the spacing of the measured angles if they lie on a grid, with or without noise; else []."""
        values = np.unique(look.raw)
        gaps = np.diff(values)
        gaps = gaps[gaps > 1e-9]
        if len(gaps) >= 4 and len(values) < 0.5 * len(look.raw):
            return [{"step": float(np.clip(np.median(gaps), 1e-6, self.params["step"].high))}]
        step = _step_in_noise(np.ascontiguousarray(look.raw).tobytes(), self.params["step"].high)
        return [{"step": step}] if step else []


@lru_cache(maxsize=64)
def _step_in_noise(readings: bytes, widest: float) -> float:
    """Return the step, rad, of readings that are rounded and then get noise; 0 if no step is found.

    Differences between readings are then near multiples of the step: Rayleigh's statistic of their phase is greatest.
    Differences over longer lags span more steps and so determine the step more finely. The result is cached, because a
    search asks for the same readings again and again.
    """
    raw = np.frombuffer(readings)
    low, high, best, width = 2e-5, widest, 0.0, 0.0  # rad, rad, rad, 1/rad
    for lag in (1, 4, 16, 64, 256):
        if lag >= len(raw) // 2:
            break
        moves = (raw[lag:] - raw[:-lag])[:: max(1, len(raw) // 1500)]
        inverse = np.linspace(1 / high, 1 / low, 2500) if not best else 1 / best + np.linspace(-1, 1, 400) * width
        statistic = _clustered(moves, inverse)
        resolution = 1.0 / max(np.ptp(moves), 1e-12)
        statistic[inverse < 2 * resolution] = 0.0  # a step wider than half the motion fits anything
        top = int(np.argmax(statistic))
        if statistic[top] < 0.25:
            return float(best) if lag > 4 else 0.0  # two lags must show a step
        best, width = 1.0 / inverse[top], 0.5 * resolution
    return float(best)


def _clustered(moves: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Return Rayleigh's statistic (k,), 0 to 1, of moves (n,) rad on grids with steps 1 / `inverse` (k,), 1/rad.

    `inverse` is evenly spaced, so from one to the next every phase turns by the same angle.
    """
    turned, turn = (np.exp(2j * np.pi * moves * s) for s in (inverse[0], inverse[1] - inverse[0]))
    out = np.empty(len(inverse))
    for k in range(len(inverse)):
        out[k] = abs(turned.mean())
        turned *= turn
    return out
