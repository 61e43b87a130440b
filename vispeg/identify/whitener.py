"""Marginalise nuisance errors: the covariance of a residual is white noise plus the effect of a few unknowns.

In noise units C = I + G G', where column j of G (n readings, k unknowns) is the effect of one standard deviation of
unknown j. Then C^-1/2 = I - U (1 - (1 + L)^-1/2) U' with G G' = U L U' (Woodbury, Memorandum Report 42, Statistical
Research Group, Princeton, 1950).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Whitener:
    """C^-1/2 of readings in units of their noise.

    Attributes:
        basis: (n, r), orthonormal columns U; r <= k is the rank of G.
        shrink: (r,) 1 - (1 + L)^-1/2.
        logdet: log det C.
    """

    basis: np.ndarray
    shrink: np.ndarray
    logdet: float

    @classmethod
    def of(cls, unknowns: np.ndarray) -> Whitener:
        """Build from columns (n, k), each the effect of one standard deviation of one unknown."""
        value, vector = np.linalg.eigh(unknowns.T @ unknowns)
        good = value > 1e-10 * max(float(value.max(initial=0.0)), 1e-30)
        value, vector = value[good], vector[:, good]
        basis = unknowns @ vector / np.sqrt(value)
        return cls(basis, 1 - 1 / np.sqrt(1 + value), float(np.log1p(value).sum()))

    def __call__(self, residual: np.ndarray) -> np.ndarray:
        """Return the residual (n,) or (n, c) whitened."""
        along = self.basis.T @ residual
        shrink = self.shrink if along.ndim == 1 else self.shrink[:, None]
        return residual - self.basis @ (shrink * along)
