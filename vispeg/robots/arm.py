"""Turn any robot description into a torque-driven arm: hinges only, one motor each, a flange, no self-contact."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.robots.declare import RobotConfig

HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
LARGEST = 1e6  # kg, m, kg m^2, rad: larger numbers are taken for mistakes
REFUSALS = (ValueError, TypeError, RuntimeError, MemoryError, mujoco.FatalError)  # MuJoCo's errors for a bad model
FLANGE_WORDS = ("flange", "tool0", "attachment", "ee")  # best first
Limits = Mapping[str, tuple[float, float]]  # joint -> (N m, rad/s)
FREE = (np.inf, np.inf)  # limits of a joint for which none are known


@dataclass(frozen=True)
class Arm:
    """Names and limits of a prepared arm; the attributes are those of `RobotModel`, `torque` and `speed` its limits."""

    joints: tuple[str, ...]
    links: tuple[str, ...]
    base: str
    flange: str
    range: np.ndarray
    torque: np.ndarray
    speed: np.ndarray

    def check(self, spec: mujoco.MjSpec, label: str) -> None:
        """Compile a copy and check that every joint has inertia.

        Raises:
            UserError: MuJoCo refuses the model, or a joint moves no mass.
        """
        model = compiled(spec, label)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        for i, joint in enumerate(self.joints):
            if full[i, i] < 1e-9:
                raise UserError("this joint moves no mass", file=label, key=joint, expected="a link with an inertia")


def prepare(
    spec: mujoco.MjSpec, limits: Limits, label: str, declared: RobotConfig, moved: Sequence[str] | None = None
) -> Arm:
    """Edit `spec` in place into a torque-driven arm and return its names and limits.

    Sliding joints (grippers) are fixed at their initial position. If joints are fixed, all tendons and the equality
    constraints on tendons and fixed joints are removed.

    Geoms of the robot collide with geoms that a scene adds, but not with each other.

    Args:
        spec: the description, without actuators.
        limits: torque and velocity limits by joint name, N m and rad/s, where known.
        label: file or name, for errors.
        declared: flange, limits and damping that override those of the description.
        moved: hinges that stay movable; the others are fixed, as sliding joints are. None: all stay movable.

    Raises:
        UserError: the robot is not a fixed-base arm with hinges, or the declared flange is not rigidly attached to the
            last link.
    """
    _remove_bodies(spec, declared.without, label)
    _hinges_only(spec, label)
    _name(spec.joints, "joint", spec.joints)
    if moved is not None:
        _fix(spec, [joint for joint in spec.joints if joint.name not in moved])
    _name([joint.parent for joint in spec.joints], "link", spec.bodies)
    _name(spec.bodies[1:], "body", spec.bodies)
    for pair in list(spec.pairs):
        spec.delete(pair)
    for geom in spec.geoms:
        if geom.parent.name == "world":
            continue
        if geom.contype or geom.conaffinity:
            geom.contype, geom.conaffinity = 0, 1
    model = compiled(spec, label)
    joints = tuple(model.joint(i).name for i in range(model.njnt))
    links = [int(b) for b in model.jnt_bodyid]
    declared.check(len(joints), label)
    flange = _declared(spec, model, links[-1], declared, label) if declared.flange else _flange(spec, model, links[-1])
    for name in joints:
        _motor(spec, name)
    for name, damping in zip(joints, declared.damping, strict=False):  # empty if not declared
        spec.joint(name).damping = [damping, 0.0, 0.0]
    free = np.array([[-np.inf, np.inf]])
    return Arm(
        joints=joints,
        links=tuple(model.body(b).name for b in links),
        base=model.body(int(model.body_parentid[links[0]])).name,
        flange=flange,
        range=_frozen(np.where(model.jnt_limited[:, None], model.jnt_range, free)),
        torque=_frozen(np.array(declared.torque_limit or [limits.get(j, FREE)[0] for j in joints], float)),
        speed=_frozen(np.array(declared.velocity_limit or [limits.get(j, FREE)[1] for j in joints], float)),
    )


def _name(elements: Sequence[Any], word: str, group: Sequence[Any]) -> None:
    """Name each element without a name: `word` and the first number from its position on that is free in its group."""
    taken = {element.name for element in group}
    for i, element in enumerate(elements, start=1):
        element.name = element.name or next(name for k in count(i) if (name := f"{word}{k}") not in taken)
        taken.add(element.name)


def compiled(spec: mujoco.MjSpec, label: str) -> mujoco.MjModel:
    """Compile a copy of `spec`; an error of MuJoCo becomes a UserError."""
    try:
        model = spec.copy().compile()
    except REFUSALS as error:
        raise UserError(f"MuJoCo cannot compile it: {error}", file=label) from error
    _check_numbers(model, label)
    return model


def _check_numbers(model: mujoco.MjModel, label: str) -> None:
    """Raise UserError for a body or joint with a number that is not finite or implausibly large."""
    if not np.isfinite(model.opt.gravity).all():
        raise UserError("gravity is not finite", file=label, got=model.opt.gravity.tolist())
    limited = np.where(model.jnt_limited[:, None], model.jnt_range, 0.0)
    bodies = {k: getattr(model, f"body_{k}") for k in ("mass", "inertia", "pos", "quat", "ipos", "iquat")}
    joints = {"axis": model.jnt_axis, "pos": model.jnt_pos, "range": limited, "ref": model.qpos0[model.jnt_qposadr]}
    for kind, arrays in (("body", bodies), ("joint", joints)):
        for key, values in arrays.items():
            size = values.size // max(1, len(values))  # numbers per element
            largest = np.abs(values).reshape(len(values), size).max(axis=1, initial=0.0)
            bad = np.flatnonzero(~(largest <= LARGEST))  # NaN too
            if len(bad):
                name = getattr(model, kind)(int(bad[0])).name
                got = np.ravel(values[bad[0]]).tolist()
                expected = f"finite numbers, at most {LARGEST:g}"
                raise UserError(f"implausible {key}", file=label, key=name or kind, expected=expected, got=got)


def _remove_bodies(spec: mujoco.MjSpec, names: Sequence[str], label: str) -> None:
    """Delete the named bodies with their subtrees, and everything that refers to them."""
    for name in names:
        body = spec.body(name)
        if body is None or name == "world":
            choices = [b.name for b in spec.bodies if b.name not in ("", "world")]
            raise UserError("no such body", file=label, key="robot.without", got=name, choices=choices)
        spec.delete(body)


def _hinges_only(spec: mujoco.MjSpec, label: str) -> None:
    """Fix free bodies and sliding joints. Raises UserError: another joint than hinges is left, or no hinge."""
    _fix_free_bodies(spec)
    slides = [j for j in spec.joints if j.type == SLIDE]
    for joint in spec.joints:
        if joint.type not in (HINGE, SLIDE):
            raise UserError("a free or ball joint", file=label, key=joint.name, expected="a fixed-base arm with hinges")
    carrying = [joint.name for joint in slides if _carries(joint)]
    if carrying:  # fingers of a gripper carry no hinge, so fixing them does not change how the arm moves
        named = ", ".join(sorted(name or "without a name" for name in carrying))
        note(f"{label}: sliding joints that carry others are fixed at their initial position: {named}")
    _fix(spec, slides)
    if not list(spec.joints):
        raise UserError("no hinge joint", file=label, expected="an arm with revolute (hinge) joints")


def _fix(spec: mujoco.MjSpec, joints: Sequence[mujoco.MjsJoint]) -> None:
    """Fix joints at their initial position; remove all tendons, and equality constraints on tendons or these joints."""
    if not joints:
        return
    gone = {joint.name for joint in joints}
    for tendon in list(spec.tendons):
        spec.delete(tendon)
    for equality in list(spec.equalities):
        of_tendon = equality.type == mujoco.mjtEq.mjEQ_TENDON
        if of_tendon or equality.type == mujoco.mjtEq.mjEQ_JOINT and gone & {equality.name1, equality.name2}:
            spec.delete(equality)
    for joint in joints:
        spec.delete(joint)


def _carries(joint: mujoco.MjsJoint) -> bool:
    """Return whether a sliding joint moves a hinge, as a linear axis under an arm does."""
    return any(j.type == HINGE for j in joint.parent.find_all(mujoco.mjtObj.mjOBJ_JOINT))


def _fix_free_bodies(spec: mujoco.MjSpec) -> None:
    """Fix free bodies without other joints, such as parts on a bench, at the pose in the file."""
    for joint in [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]:
        if len(list(joint.parent.find_all(mujoco.mjtObj.mjOBJ_JOINT))) == 1 and len(list(spec.joints)) > 1:
            spec.delete(joint)


def _motor(spec: mujoco.MjSpec, joint: str) -> None:
    motor = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_motor()
    motor.gear = [1, 0, 0, 0, 0, 0]
    motor.ctrllimited = motor.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE
    spec.joint(joint).actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE  # drives saturate by effects alone


def _flange(spec: mujoco.MjSpec, model: mujoco.MjModel, last: int) -> str:
    """Return the name of the flange site; if there is none, add "flange" at the frame with the most likely name.

    Frames rigidly attached to the last link are searched first, then those of the link before it, because the last
    joints may be fingers. Without any such name, the flange is the body of the last joint.
    """
    if any(s.name == "flange" for s in spec.sites):
        return "flange"
    beyond = f"link{model.njnt + 1}"  # such as Franka's link8 after seven joints
    rigid = int(model.body_weldid[last])
    while rigid:
        bodies = np.flatnonzero(model.body_weldid == rigid)
        frames = [(model.site(s).name, "site", s) for s in range(model.nsite) if model.site_bodyid[s] in bodies]
        frames += [(model.body(b).name, "body", b) for b in bodies]
        for word in (*FLANGE_WORDS, beyond):
            for name, kind, index in frames:
                if word in re.split(r"[^a-z0-9]+", name.lower()):
                    if kind == "site":
                        body = model.body(int(model.site_bodyid[index])).name
                        return _add_flange(spec, body, model.site_pos[index], model.site_quat[index])
                    return _add_flange(spec, name)
        rigid = int(model.body_weldid[model.body_parentid[rigid]])
    return _add_flange(spec, model.body(last).name)


def _declared(spec: mujoco.MjSpec, model: mujoco.MjModel, last: int, declared: RobotConfig, label: str) -> str:
    """Add the flange site at the declared frame, which must be rigidly attached to the last link; return its name."""
    rigid = [b for b in range(model.nbody) if model.body_weldid[b] == model.body_weldid[last]]
    sites = {model.site(s).name: s for s in range(model.nsite) if model.site_bodyid[s] in rigid}
    bodies = [model.body(b).name for b in rigid]
    name = declared.flange
    pos, quat = np.zeros(3), np.empty(4)
    turn = np.array(declared.flange_quat) / np.linalg.norm(declared.flange_quat)
    if name in sites:
        site = sites[name]
        body, frame = model.body(int(model.site_bodyid[site])).name, model.site_quat[site]
        mujoco.mju_rotVecQuat(pos, np.array(declared.flange_pos), frame)
        pos += model.site_pos[site]
    elif name in bodies:
        body, frame, pos = name, np.array([1.0, 0.0, 0.0, 0.0]), np.array(declared.flange_pos)
    else:
        choices = [c for c in (*sites, *bodies) if c]
        what = "no such site or body beyond the last joint"
        raise UserError(what, file=label, key="robot.flange", got=name, choices=choices)
    mujoco.mju_mulQuat(quat, frame, turn)
    for site in [s for s in spec.sites if s.name == "flange"]:
        site.name = "flange of the file"
    return _add_flange(spec, body, pos, quat)


def _add_flange(spec: mujoco.MjSpec, body: str, pos=(0.0, 0.0, 0.0), quat=(1.0, 0.0, 0.0, 0.0)) -> str:
    spec.body(body).add_site(name="flange", pos=pos, quat=quat, group=4)
    return "flange"


def _frozen(array: np.ndarray) -> np.ndarray:
    array = np.array(array)
    array.flags.writeable = False
    return array
