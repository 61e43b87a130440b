"""Whether an effect is worth its parameters: BIC with the effective sample size of a structured residual."""

from __future__ import annotations

import numpy as np

from vispeg.diagnosis.selection.judge import parameters
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.worlds.world import World


def bic_gain(evidence: Evidence, world: World, residual: np.ndarray, fit: Fit) -> float:
    """Drop of the Bayesian information criterion `n log(mean r^2) + k log n` from a world to a fit of a richer one.

    n is the number of independent readings N / (2 tau_int) of the world's `residual` (flat, whitened): the more
    structured it is, the fewer. Source: Schwarz, Annals of Statistics 6(2), 1978.
    """
    n = max(2.0, evidence.count / (2.0 * correlation_time(evidence, residual)))
    more = parameters(fit.world) - parameters(world)
    return float(n * np.log(np.mean(residual**2) / np.mean(fit.residual**2)) - more * np.log(n))


def correlation_time(evidence: Evidence, residual: np.ndarray) -> float:
    """Integrated autocorrelation time of the angle residuals in samples, >= 0.5 (white)."""
    out, start = [], 0
    for item in evidence.items:
        r = residual[start : start + item.measured.size].reshape(item.measured.shape)[item.valid.all(axis=1)]
        start += item.measured.size
        if len(r) < 16:
            continue
        r = r - r.mean(axis=0)
        f = np.abs(np.fft.rfft(r, 2 * len(r), axis=0)) ** 2
        acf = np.fft.irfft(f.sum(axis=1))[: len(r)]
        acf /= max(acf[0], 1e-300)
        tau = 0.5 + np.cumsum(acf[1:])
        window = np.flatnonzero(np.arange(1, len(r)) >= 5 * tau)  # Sokal's self-consistent window
        out.append(tau[window[0]] if len(window) else tau[-1])
    return float(max(0.5, np.mean(out))) if out else 0.5
