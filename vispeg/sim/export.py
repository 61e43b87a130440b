"""A world's arm as an MJCF for plain MuJoCo: effects that MuJoCo has natively as its elements, the others by name.

Friction, damping, rotor inertia, springs, inertials and gravity are numbers of the model, so they are written as the
plant of rollouts holds them. A motor's gain, bias and limit are its actuator's: the force is
`clip(gain ctrl + bias, bias - limit, bias + limit)`, which is the drive chain's order.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from vispeg.core.effect import Effect, EffectInstance, effect
from vispeg.robots.model import RobotModel, load
from vispeg.sim.placement import activate
from vispeg.sim.plant import Plant
from vispeg.worlds.world import World

HOOKS = ("drive", "torque", "friction", "observe", "wrench", "believe", "image", "start")  # no element of an MJCF
MOTOR = ("torque_gain", "joint_bias", "torque_limit")
STEP = 1e-3  # s


@dataclass(frozen=True)
class Exported:
    """An MJCF.

    Attributes:
        xml: the text; files of meshes are named relative to its folder.
        native: effects that are elements of it.
        left_out: those that MuJoCo has no element for.
        meshes: name in the text -> file to copy there.
    """

    xml: str
    native: tuple[EffectInstance, ...]
    left_out: tuple[EffectInstance, ...]
    meshes: dict[str, Path]


def compiled_with(world: World) -> tuple[mujoco.MjModel, tuple[EffectInstance, ...]]:
    """The arm with the effects that MuJoCo has elements for, compiled; and the effects that it has none for."""
    made = to_mjcf(world, "meshes")
    assets = {name: file.read_bytes() for name, file in made.meshes.items()}
    return mujoco.MjModel.from_xml_string(made.xml, assets), made.left_out


def to_mjcf(world: World, meshes: str = "meshes") -> Exported:
    """The arm of a world with its effects.

    Args:
        world: robot, tool and effects with values.
        meshes: folder beside the text that shall hold the meshes.
    """
    robot = load(world.robot, tool=world.tool)
    native = tuple(e for e in world.effects if is_native(effect(e.effect)))
    spec = robot.spec()
    native_world = World(world.robot, world.tool, tuple(e for e in native if e.effect not in MOTOR))
    plant = Plant(robot, [native_world], STEP, STEP, 1)
    _numbers(spec, robot, plant)
    _motors(spec, robot, [e for e in native if e.effect in MOTOR])
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    files: dict[str, Path] = {}
    base = Path(spec.modelfiledir or ".") / (spec.meshdir or "")
    for mesh in spec.meshes:
        if mesh.file:
            file = base / mesh.file  # an absolute name stays itself
            name = f"{meshes}/{mesh.name or file.stem}{file.suffix}"
            files[name] = file
    spec.compile()
    left_out = tuple(e for e in world.effects if e not in native)
    return Exported(listed(left_out) + _relative(spec.to_xml(), files), native, left_out, files)


def is_native(kind: Effect) -> bool:
    """Whether an MJCF has elements that do all of what an effect does."""
    return kind.name in MOTOR or (bool(kind.writes) and not any(kind.overrides(hook) for hook in HOOKS))


def _numbers(spec: mujoco.MjSpec, robot: RobotModel, plant: Plant) -> None:
    """Writes what effects have made of the model's numbers into the elements they belong to."""
    model = plant.model

    def value(field: str) -> np.ndarray | None:
        rows = plant.batch.expanded(field)
        return None if rows is None else np.array(rows[0])

    for attribute, field in (
        ("frictionloss", "dof_frictionloss"),
        ("armature", "dof_armature"),
        ("solref_friction", "dof_solref"),
        ("solimp_friction", "dof_solimp"),
    ):
        if (numbers := value(field)) is not None:
            for name in robot.joints:
                setattr(spec.joint(name), attribute, numbers[model.joint(name).dofadr[0]])
    for attribute, field in (("damping", "dof_damping"), ("stiffness", "jnt_stiffness")):
        if (numbers := value(field)) is not None:
            for name in robot.joints:
                at = model.joint(name).dofadr[0] if attribute == "damping" else model.joint(name).id
                setattr(spec.joint(name), attribute, [numbers[at], 0.0, 0.0])
    if (numbers := value("qpos_spring")) is not None:
        for name in robot.joints:
            spec.joint(name).springref = numbers[model.joint(name).qposadr[0]]
    _inertials(spec, model, {f: value(f) for f in ("body_mass", "body_ipos", "body_iquat", "body_inertia")})
    if (gravity := value("opt.gravity")) is not None:
        spec.option.gravity = gravity.reshape(3)


def _inertials(spec: mujoco.MjSpec, model: mujoco.MjModel, changed: dict[str, np.ndarray | None]) -> None:
    """States mass, centre and principal inertia of every body that an effect has changed."""
    for body in spec.bodies[1:]:
        i = model.body(body.name).id
        now = {f: getattr(model, f)[i] if rows is None else rows[i] for f, rows in changed.items()}
        if all(np.array_equal(x, getattr(model, f)[i]) for f, x in now.items()):
            continue
        body.explicitinertial = True
        body.mass, body.ipos, body.iquat = float(now["body_mass"]), now["body_ipos"], now["body_iquat"]
        body.inertia, body.fullinertia = now["body_inertia"], [np.nan, 0, 0, 0, 0, 0]


def _motors(spec: mujoco.MjSpec, robot: RobotModel, effects: list[EffectInstance]) -> None:
    """Gain, bias and limit of each motor."""
    values = {a.effect.name: a.p for a in activate(robot, [World(robot.name, None, tuple(effects))])} if effects else {}
    for j, name in enumerate(robot.joints):
        motor = spec.actuator(name)
        if "torque_gain" in values:
            motor.gainprm[0] = values["torque_gain"]["gain"][0, j]
        bias = float(values["joint_bias"]["torque"][0, j]) if "joint_bias" in values else 0.0
        if bias:
            motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            motor.biasprm[0] = bias
        limit = effect("torque_limit").params["limit"].null
        limit = float(values["torque_limit"]["limit"][0, j]) if "torque_limit" in values else limit
        if limit < effect("torque_limit").params["limit"].null:
            motor.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            motor.forcerange = (bias - limit, bias + limit)


def _relative(xml: str, files: dict[str, Path]) -> str:
    for name, file in files.items():
        xml = xml.replace(f'file="{file}"', f'file="{name}"').replace(f'file="{file.name}"', f'file="{name}"')
    return xml


def listed(left_out: tuple[EffectInstance, ...], who: str = "MuJoCo") -> str:
    """A comment that says what the model has and a file has not; empty where it has all."""
    lines = []
    for e in left_out:
        values = ", ".join(f"{k} {v.value:g} {effect(e.effect).params[k].unit}" for k, v in e.params.items())
        lines.append(f"  {e.label}: {values}".replace("--", "- -"))
    comment = "\n".join([f"Effects of the model that {who} has no element for:", *lines])
    return f"<!-- {comment} -->\n" if left_out else ""
