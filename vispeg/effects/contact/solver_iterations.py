"""Solver iterations: the constraint solver may take `scale` times its nominal number of iterations, at least one.

This is no physics but an error of the simulator: a solver that stops early lets bodies penetrate, and a policy that
exploits that fails once the number varies. Native mechanism: `opt.iterations`. Newton's method converges after a few
iterations, so only a small `scale` has an effect. Source: MuJoCo 4.0 manual, Computation, Solver.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import in_scene


class SolverIterations(Effect):
    """Iteration limit of the contact solver."""

    name = "solver_iterations"
    family = "contact"
    smooth = False
    params = {"scale": Param(1.0, 0.01, 4.0, "1", start=0.02, scale="log", doc="most iterations over nominal")}
    writes = frozenset({"opt.iterations"})

    def targets(self, model):
        return in_scene(model, "scene")

    def write(self, fields, p):
        count, rows = fields["opt.iterations"], p["scale"][:, 0] != 1.0
        count[rows] = np.maximum(1, np.round(count[rows] * p["scale"][rows, 0]))
