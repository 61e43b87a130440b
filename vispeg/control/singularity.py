"""How near an arm is to a singularity."""

from __future__ import annotations

import numpy as np


def singular(jac: np.ndarray) -> np.ndarray:
    """Smallest singular value (n,) of flange Jacobians (n, 6, nj), in m/rad and rad/rad together; 0 at a singularity.

    It is the least speed of the flange, in any direction, that joint speeds of unit norm give: Klein and Blaho, Int. J.
    Robotics Research 6(2), 1987. Lengths count in metres: a turn of 1 rad weighs as much as a way of 1 m.
    """
    return np.linalg.svd(jac, compute_uv=False)[:, -1]
