"""Presliding: springs side by side that yield one after the other, as gear teeth and cable sheaths do before they slip.

Maxwell-slip elements, `torque = -mean(clip(stiffness (q - z_i), +-r_i level))`, each anchor z_i dragged along once its
element slips. Their yields r_i are spread evenly up to twice their mean: so the torque bends smoothly after a reversal,
as presliding is measured to do, where one element has a corner. All of them have yielded after twice
`level / stiffness`. MuJoCo's own mechanism is a fixed tendon with `springyield`, which needs a compiled model for each
candidate. Source: Iwan, Journal of Applied Mechanics 33(4), 1966, the even distribution; for friction Al-Bender,
Lampaert and Swevers, IEEE Trans. Automatic Control 50(11), 2005, eq. (3).
"""

from __future__ import annotations

import numpy as np

from vispeg.kernels.presliding import stretched

YIELDS = np.array([0.25, 0.75, 1.25, 1.75])  # of the level: at which each element slips; their mean is 1


def slack(q: np.ndarray) -> np.ndarray:
    """Anchors (nsim, nj, 4) rad of elements without torque at q (nsim, nj) rad."""
    return np.repeat(q[..., None], len(YIELDS), axis=-1)


def softened(stiffness: np.ndarray, inertia: np.ndarray, h: float) -> np.ndarray:
    """Stiffness (nsim, nj) N m/rad that a step can follow, of what is stiffer than that on a light link.

    Springs taken at the whole step are of second order and lose no energy; the leapfrog is stable for (omega h)^2 under
    4, and this keeps it under 2 for a joint alone.
    """
    return stiffness / (1.0 + 0.5 * stiffness * h**2 / inertia)


def pull(anchors: np.ndarray, q: np.ndarray, stiffness: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Torque (nsim, nj) N m of the elements at q; drags the `anchors` (nsim, nj, 4) of those that slip, in place.

    Args:
        anchors: rad, where each element has no torque.
        q: (nsim, nj) rad.
        stiffness: of all elements before any slips, N m/rad.
        level: torque when all of them slip, N m.
    """
    q, reach = q[..., None], (level / stiffness)[..., None] * YIELDS
    stretched = np.clip(q - anchors, -reach, reach)
    anchors[:] = q - stretched
    return -stiffness * stretched.mean(axis=-1)


def yielding(path: np.ndarray, reach: float) -> np.ndarray:
    """Mean stretch (n,) of the elements, which yield at `reach` in the mean, along a path (n,) that begins without."""
    out = np.empty(len(path))
    stretched(path, reach, YIELDS, out)
    return out
