"""Decide whether an effect is worth its parameters: BIC with the effective sample size of a correlated residual.

Neighbouring readings share errors, so N readings count as fewer independent ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.diagnosis.selection.judge import parameters
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.worlds.world import World


def bic_gain(evidence: Evidence, world: World, residual: np.ndarray, fit: Fit) -> float:
    """Return the drop of the criterion `n log(mean r^2) + k log n` (BIC) from a world to the fit of a larger one.

    n is the number of independent readings N / (2 tau_int) of the world's `residual` (flat, whitened): the more
    correlated it is, the fewer. Source: Schwarz, Annals of Statistics 6(2), 1978.
    """
    n = max(2.0, evidence.count / (2.0 * correlation_time(evidence, residual)))
    added = parameters(fit.world) - parameters(world)
    return float(n * np.log(np.mean(residual**2) / np.mean(fit.residual**2)) - added * np.log(n))


def correlation_time(evidence: Evidence, residual: np.ndarray) -> float:
    """Return the integrated autocorrelation time of a flat whitened residual in samples; 0.5 if it is white."""
    return time_of([_lags((np.abs(f) ** 2).sum(axis=1)) for f in spectra(evidence, residual)])


def spectra(evidence: Evidence, residual: np.ndarray) -> list[np.ndarray]:
    """Return for each item the Fourier transform (n + 1, nch) of its residual, minus each column's mean.

    n is the number of samples valid in all columns that are read at all; items with fewer than 16 are left out.
    """
    out, start = [], 0
    for item in evidence.items:
        rows = (item.valid | ~item.valid.any(axis=0)).all(axis=1)
        r = residual[start : start + item.measured.size].reshape(item.measured.shape)[rows]
        start += item.measured.size
        if len(r) < 16:
            continue
        r = r - r.mean(axis=0)
        out.append(np.fft.rfft(r, 2 * len(r), axis=0))
    return out


def correlations(a: Sequence[np.ndarray], b: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return for each item the correlation (n,) of two residuals at lags 0 to n - 1, from their `spectra`.

    It is the mean over positive and negative lags, so it adds up over sums of residuals.
    """
    return [_lags(np.real(np.sum(np.conj(f) * g, axis=1))) for f, g in zip(a, b, strict=True)]


def _lags(power: np.ndarray) -> np.ndarray:
    """Return the correlation (n,) by lag of a power spectrum (n + 1,)."""
    return np.fft.irfft(power)[: len(power) - 1]


def time_of(correlation: Sequence[np.ndarray]) -> float:
    """Return the integrated autocorrelation time in samples from each item's autocorrelation."""
    out = []
    for acf in correlation:
        acf = acf / max(acf[0], 1e-300)
        tau = 0.5 + np.cumsum(acf[1:])
        window = np.flatnonzero(np.arange(1, len(acf)) >= 5 * tau)  # Sokal's self-consistent window
        out.append(tau[window[0]] if len(window) else tau[-1])
    return float(max(0.5, np.mean(out))) if out else 0.5
