"""Springs that hold a part of the cell: joints that only models of worlds with such an effect have.

A spring of compliance c (m/N or rad/(N m)) has stiffness 1/c, an inertia `EFFECTIVE` in addition to the part's own, and
damping ratio `RATIO`. Both keep the spring from ringing and do not change its deflection at rest. Stiff springs get
more inertia, so that omega h <= 1 at a step of `STEP` s: the semi-implicit Euler rule needs < 2 (MuJoCo 4.0 manual,
Computation, Numerical integration). An absent spring has compliance `LOCKED`. A stiffer one would need so much inertia
that the solver, whose tolerance is relative to the mean inertia, would become inaccurate.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from vispeg.core.effect import Values
from vispeg.core.params import Param

SLIDE, HINGE = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
AXES = {  # parameter -> joint type and axis
    "x": (SLIDE, (1, 0, 0)),
    "y": (SLIDE, (0, 1, 0)),
    "z": (SLIDE, (0, 0, 1)),
    "roll": (HINGE, (1, 0, 0)),
    "pitch": (HINGE, (0, 1, 0)),
}
LOCKED = {SLIDE: 1e-7, HINGE: 1e-5}  # m/N, rad/(N m): 1 um at 10 N
EFFECTIVE = {SLIDE: 1.0, HINGE: 2e-3}  # kg, kg m^2, inertia of a spring
RATIO, STEP = 0.7, 2e-3  # damping ratio; s, longest physics step for which the inertia suffices
TOLERANCE = 1e-10  # tolerance of the solver in models with springs
WRITES = frozenset({"jnt_stiffness", "dof_armature", "dof_damping"})


def coefficients(kind: mujoco.mjtJoint, compliance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stiffness, inertia and damping of springs with this compliance (> 0), in arrays of its shape.

    Slides have N/m, kg and N s/m, hinges N m/rad, kg m^2 and N m s/rad.
    """
    stiffness = 1.0 / compliance
    inertia = np.maximum(EFFECTIVE[kind], stiffness * STEP**2)
    return stiffness, inertia, 2 * RATIO * np.sqrt(stiffness * inertia)


def add(spec: mujoco.MjSpec, body: str, prefix: str, axes: tuple[str, ...], pos: tuple[float, float, float]) -> None:
    """Mount a body of a spec on locked springs `PREFIX_AXIS`; hinges pass through `pos` in m, body frame."""
    part = spec.body(body)
    spec.option.tolerance = TOLERANCE
    for axis in axes:
        kind, direction = AXES[axis]
        stiffness, inertia, damping = (float(v) for v in coefficients(kind, np.array(LOCKED[kind])))
        joint = part.add_joint(name=f"{prefix}_{axis}", type=kind, axis=direction, pos=pos, armature=inertia)
        joint.stiffness, joint.damping = [stiffness, 0.0, 0.0], [damping, 0.0, 0.0]


def write(fields: Any, prefix: str, p: Values) -> None:
    """Set the springs `PREFIX_AXIS` to compliances p[axis] (nsim, 1), m/N or rad/(N m); rows at 0 stay locked.

    `fields` maps the names in `WRITES` to model fields (nsim, ...); `fields.model` is the MjModel.
    """
    stiffness, armature, damping = (fields[name] for name in ("jnt_stiffness", "dof_armature", "dof_damping"))
    for axis, value in p.items():
        rows = np.flatnonzero(value[:, 0] > 0)
        joint = fields.model.joint(f"{prefix}_{axis}")
        kind, dof = AXES[axis][0], int(joint.dofadr[0])
        set_to = coefficients(kind, np.maximum(value[rows, 0], LOCKED[kind]))
        stiffness[rows, joint.id], armature[rows, dof], damping[rows, dof] = set_to


def compliances(texts: Mapping[str, str]) -> dict[str, Param]:
    """Return the compliance parameters of springs by axis; `texts` has the `doc` of each."""
    out = {}
    for axis, text in texts.items():
        turn = AXES[axis][0] == HINGE
        high, start, unit = (2e-2, 5e-4, "rad/(N m)") if turn else (1e-3, 3e-5, "m/N")
        out[axis] = Param(0.0, 0.0, high, unit, start=start, doc=text)
    return out
