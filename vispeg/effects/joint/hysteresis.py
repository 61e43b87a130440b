"""Elasto-plastic hysteresis: springs that yield one after the other, the presliding of gear teeth and cable sheaths.

Maxwell-slip elements side by side, `tau = -mean(clip(stiffness (q - z_i), +-r_i torque))`, each anchor z_i dragged
along once its element slips. Their yields r_i are spread evenly up to twice their mean: so the torque bends smoothly
after a reversal, as presliding is measured to do, where one element has a corner. All of them have yielded after twice
`torque / stiffness`. The springs are taken at the whole step, where the stepping is second order and loses no energy;
what is stiffer than the step can follow on a light link is softened to what it can. MuJoCo's own mechanism is a fixed
tendon with `springyield`, which needs a compiled model for each candidate. Source: Iwan, Journal of Applied Mechanics
33(4), 1966, the even distribution; for friction Al-Bender, Lampaert and Swevers, IEEE Trans. Automatic Control 50(11),
2005, eq. (3).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param

YIELDS = np.array([0.25, 0.75, 1.25, 1.75])  # of `torque`: at which each element slips; their mean is 1


class Hysteresis(Effect):
    """Elastoplastic elements in parallel with the joint."""

    name = "hysteresis"
    family = "joint"
    params = {
        "torque": Param(0.0, 0.0, 30.0, "N m", start=0.5, doc="torque at which all elements slip"),
        "stiffness": Param(200.0, 5.0, 3000.0, "N m/rad", start=200.0, shape=True, scale="log", doc="before any slips"),
    }
    smooth = False
    contains = ("coulomb_friction",)

    def start(self, x, p):
        return {"anchors": np.repeat(x.q[..., None], len(YIELDS), axis=-1)}  # (nsim, nj, 4) rad

    def torque(self, state, x, p):
        soft = 1.0 + 0.5 * p["stiffness"] * x.h**2 / x.inertia  # keeps (omega h)^2 under 2; leapfrog is stable under 4
        stiffness, q = p["stiffness"] / soft, x.q[..., None]
        reach = (p["torque"] / stiffness)[..., None] * YIELDS
        stretched = np.clip(q - state["anchors"], -reach, reach)
        state["anchors"] = q - stretched
        return -stiffness * stretched.mean(axis=-1)

    def along(self, path, p):
        k, reach = (
            np.broadcast_to(np.ravel(v), path.shape[1:]) for v in (p["stiffness"], p["torque"] / p["stiffness"])
        )
        return -k * np.stack([yielding(q, r) for q, r in zip(path.T, reach, strict=True)], axis=1)

    def guesses(self, look):
        return [{"stiffness": 50.0}, {"stiffness": 500.0}]


def yielding(path: np.ndarray, reach: float) -> np.ndarray:
    """Mean stretch (n,) of the elements, which yield at `reach` in the mean, along a path (n,) that begins without."""
    return np.mean([stretch(path, reach * r) for r in YIELDS], axis=0)


def stretch(path: np.ndarray, reach: float) -> np.ndarray:
    """Stretch (n,) of one element that yields at `reach` along a path (n,) that begins with it slack.

    Between two turns of the path the anchor stays, until the element slips and drags it: one clip a stretch of path.
    """
    out, anchor = np.zeros(len(path)), path[0]
    step = np.diff(path)
    moves = np.flatnonzero(step)
    turns = moves[1:][np.diff(np.sign(step[moves])) != 0]
    for first, last in zip([0, *turns], [*turns, len(path) - 1], strict=True):
        part = slice(first, last + 1)
        out[part] = np.clip(path[part] - anchor, -reach, reach)
        anchor = np.clip(anchor, path[last] - reach, path[last] + reach)
    return out
