"""Springs that hold a part of the cell: joints that only models of worlds with such an effect have.

A spring of compliance c (m/N or rad/(N m)) has stiffness 1/c, an inertia `EFFECTIVE` in addition to the part's own, and
damping ratio `RATIO`. Both keep the spring from ringing and do not change its deflection at rest. Stiff springs get
more inertia, so that omega h <= 1 at a step of `STEP` s: the semi-implicit Euler rule needs < 2 (MuJoCo 4.0 manual,
Computation, Numerical integration). An absent spring has compliance `LOCKED`. A stiffer one would need so much inertia
that the solver, whose tolerance is relative to the mean inertia, would become inaccurate.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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


def sprung(model: mujoco.MjModel, own: int, body: int, pose: np.ndarray, qpos: np.ndarray) -> np.ndarray:
    """Return the pose (7,) of a body in its parent, displaced by its springs, for a model without the springs' joints.

    Args:
        model: the model with springs, whose joints come last.
        own: number of positions of the model without them.
        body: id of the body.
        pose: (7,) of the body in its parent, m and w x y z, with all joints at rest.
        qpos: (nq,) m and rad.

    Returns:
        The pose (7,) from which the body's own joints, without the springs, lead to its position.
    """
    first = int(model.body_jntadr[body])
    joints = range(first, first + int(model.body_jntnum[body]))
    own_joints = [j for j in joints if model.jnt_qposadr[j] < own]
    if len(own_joints) == len(joints):
        return pose
    pos, quat, back_pos, back_quat = np.empty(3), np.empty(4), np.empty(3), np.empty(4)
    identity = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    moved, by_own = _through(model, joints, pose, qpos), _through(model, own_joints, identity, qpos)
    mujoco.mju_negPose(back_pos, back_quat, by_own[:3], by_own[3:])
    mujoco.mju_mulPose(pos, quat, moved[:3], moved[3:], back_pos, back_quat)
    return np.concatenate([pos, quat])


def _through(model: mujoco.MjModel, joints: Iterable[int], pose: np.ndarray, qpos: np.ndarray) -> np.ndarray:
    """Return a body's pose (7,) after these of its slides and hinges, from the pose (7,) before them."""
    pos, quat = pose[:3].copy(), pose[3:].copy()
    for j in joints:
        size = qpos[model.jnt_qposadr[j]] - model.qpos0[model.jnt_qposadr[j]]  # m or rad
        if model.jnt_type[j] == SLIDE.value:
            pos += size * _turned(model.jnt_axis[j], quat)
            continue
        anchor, step, turn = pos + _turned(model.jnt_pos[j], quat), np.empty(4), np.empty(4)
        mujoco.mju_axisAngle2Quat(step, model.jnt_axis[j], float(size))
        mujoco.mju_mulQuat(turn, quat, step)
        pos, quat = anchor - _turned(model.jnt_pos[j], turn), turn
    return np.concatenate([pos, quat])


def _turned(vector: np.ndarray, quat: np.ndarray) -> np.ndarray:
    out = np.empty(3)
    mujoco.mju_rotVecQuat(out, vector, quat)
    return out


def compliances(texts: Mapping[str, str]) -> dict[str, Param]:
    """Return the compliance parameters of springs by axis; `texts` has the `doc` of each."""
    out = {}
    for axis, text in texts.items():
        turn = AXES[axis][0] == HINGE
        high, start, unit = (2e-2, 5e-4, "rad/(N m)") if turn else (1e-3, 3e-5, "m/N")
        out[axis] = Param(0.0, 0.0, high, unit, start=start, doc=text)
    return out
