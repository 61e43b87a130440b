"""Errors that are no effect's, marginalised: a residual's covariance as white noise plus what few unknowns do.

With C = I + G G' in units of the noise (G: n readings, k unknowns, each column what one standard deviation of an
unknown does), C^-1/2 = I - U (1 - (1 + L)^-1/2) U' where G G' = U L U' (Woodbury, Memorandum Report 42, Statistical
Research Group, Princeton, 1950).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Whitener:
    """C^-1/2 of readings in units of their noise.

    Attributes:
        basis: (n, k) orthonormal U.
        shrink: (k,) 1 - (1 + L)^-1/2.
        logdet: log det C.
    """

    basis: np.ndarray
    shrink: np.ndarray
    logdet: float

    @classmethod
    def of(cls, unknowns: np.ndarray) -> Whitener:
        """For the columns (n, k) of what one standard deviation of each unknown does."""
        value, vector = np.linalg.eigh(unknowns.T @ unknowns)
        good = value > 1e-10 * max(float(value.max(initial=0.0)), 1e-30)
        value, vector = value[good], vector[:, good]
        basis = unknowns @ vector / np.sqrt(value)
        return cls(basis, 1 - 1 / np.sqrt(1 + value), float(np.log1p(value).sum()))

    def __call__(self, residual: np.ndarray) -> np.ndarray:
        """Give the residual (n,) or (n, c) whitened."""
        along = self.basis.T @ residual
        shrink = self.shrink if along.ndim == 1 else self.shrink[:, None]
        return residual - self.basis @ (shrink * along)
