"""Solver iterations: the constraint solver may take `scale` times its nominal number of steps, at least one.

No physics at all but the simulator's own: a policy that lives on how a solver that stops early lets contacts leak fails
once this varies. Native mechanism: `opt.iterations`. Newton's method is done after a few, so only small numbers tell.
Source: MuJoCo 4.0 manual, Computation, Solver.
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
    params = {"scale": Param(1.0, 0.01, 4.0, "1", start=0.02, scale="log", doc="of the nominal number of iterations")}
    writes = frozenset({"opt.iterations"})

    def targets(self, model):
        return in_scene(model, "scene")

    def write(self, fields, p):
        count, rows = fields["opt.iterations"], p["scale"][:, 0] != 1.0
        count[rows] = np.maximum(1, np.round(count[rows] * p["scale"][rows, 0]))
