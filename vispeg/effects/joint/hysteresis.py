"""Elasto-plastic hysteresis: a spring that yields, the presliding of gear teeth and cable sheaths.

One Maxwell-slip element: `tau = -clip(stiffness (q - z), +-torque)`, the anchor z dragged along once the element slips.
The spring is taken at the whole step, where the stepping is second order and loses no energy; one that is stiffer than
the step can follow on a light link is softened to what it can. MuJoCo's own mechanism is a fixed tendon with
`springyield`, which needs a compiled model for each candidate. Source: Al-Bender, Lampaert and Swevers,
IEEE Trans. Automatic Control 50(11), 2005, eq. (3), one element.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class Hysteresis(Effect):
    """Elastoplastic element in parallel with the joint."""

    name = "hysteresis"
    family = "joint"
    params = {
        "torque": Param(0.0, 0.0, 30.0, "N m", start=0.5, doc="torque at which the element slips"),
        "stiffness": Param(200.0, 5.0, 3000.0, "N m/rad", start=200.0, shape=True, scale="log", doc="before it slips"),
    }
    smooth = False
    contains = ("coulomb_friction",)

    def start(self, x, p):
        return {"anchor": x.q.copy()}

    def torque(self, state, x, p):
        k, limit = p["stiffness"], p["torque"]
        soft = 1.0 + 0.5 * k * x.h**2 / x.inertia  # keeps (omega h)^2 under 2; leapfrog is stable under 4
        tau = np.clip(k * (x.q - state["anchor"]) / soft, -limit, limit)
        reach = limit * soft / k
        state["anchor"] = np.clip(state["anchor"], x.q - reach, x.q + reach)
        return -tau

    def along(self, path, p):
        k, reach = (
            np.broadcast_to(np.ravel(v), path.shape[1:]) for v in (p["stiffness"], p["torque"] / p["stiffness"])
        )
        return -k * np.stack([stretch(q, r) for q, r in zip(path.T, reach, strict=True)], axis=1)

    def guesses(self, look):
        return [{"stiffness": 50.0}, {"stiffness": 500.0}]


def stretch(path: np.ndarray, reach: float) -> np.ndarray:
    """Stretch (n,) of an element that yields at `reach` along a path (n,) that begins with it slack.

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
