"""Presliding: parallel springs that slip one after the other, as gear teeth and cable sheaths do.

Four Maxwell-slip elements stand side by side. Element i is a spring from the joint to an anchor z_i, and slips at the
torque r_i `level`; it then drags its anchor along: `torque = -mean(clip(stiffness (q - z_i), +-r_i level))`. The r_i
are spread evenly about 1 (`YIELDS`), so the torque bends smoothly after a reversal, as measured presliding does; a
single element would give a corner. A motion of 1.75 `level / stiffness` from slack springs makes all of them slip.
MuJoCo's own mechanism is a fixed tendon with `springyield`, which needs a compiled model for each candidate.
Source: Iwan, Journal of Applied Mechanics 33(4), 1966, the even distribution; for friction Al-Bender,
Lampaert and Swevers, IEEE Trans. Automatic Control 50(11), 2005, eq. (3).
"""

from __future__ import annotations

import numpy as np

YIELDS = np.array([0.25, 0.75, 1.25, 1.75])  # torque at which each element slips, over `level`; their mean is 1


def slack(q: np.ndarray) -> np.ndarray:
    """Return the anchors (nsim, nj, 4) rad of elements without torque at q (nsim, nj) rad."""
    return np.repeat(q[..., None], len(YIELDS), axis=-1)


def softened(stiffness: np.ndarray, inertia: np.ndarray, h: float) -> np.ndarray:
    """Return the stiffness (nsim, nj) N m/rad, reduced so that steps of `h` s are stable on links of this inertia.

    `inertia` (nsim, nj) is each joint's, kg m^2.

    The spring torque of each step's beginning is applied (leapfrog), which is of second order and loses no energy. It
    is stable for (omega h)^2 < 4; the reduction keeps that below 2 for a joint alone.
    """
    return stiffness / (1.0 + 0.5 * stiffness * h**2 / inertia)


def pull(anchors: np.ndarray, q: np.ndarray, stiffness: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Return the torque (nsim, nj) N m of the elements at q, and move the anchors of those that slip, in place.

    Args:
        anchors: (nsim, nj, 4) rad, where each element has no torque.
        q: (nsim, nj) rad.
        stiffness: (nsim, nj) of all elements before any slips, N m/rad.
        level: (nsim, nj) torque when all of them slip, N m.
    """
    from vispeg.kernels.presliding import pulled

    out = np.empty(q.shape)
    pulled(anchors, q, stiffness, level, YIELDS, out)
    return out


def yielding(path: np.ndarray, reach: float) -> np.ndarray:
    """Return the mean stretch (n,) rad along a path (n,) rad that begins with slack elements.

    The elements slip at a stretch of `reach` rad on average.
    """
    from vispeg.kernels.presliding import stretched

    out = np.empty(len(path))
    stretched(path, reach, YIELDS, out)
    return out
