"""Export a world as an MJCF for plain MuJoCo: native effects become elements, the others are listed in a comment.

The world is an arm, or a scene around it. Friction, damping, rotor inertia, springs, inertials, contact, positions and
gravity are fields of the model and are written with the values that the plant of rollouts has. A motor's gain, bias and
limit become those of its actuator: the force is `clip(gain ctrl + bias, bias - limit, bias + limit)`, in the order of
the drive chain. With the effect `servo`, actuators take goals and the force is k (K ctrl - q) - d dq with k = J w^2 and
d = 2 J zeta w (`common.servo_loop`).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import mujoco
import numpy as np

from vispeg.core.effect import OPTICAL, Effect, EffectInstance, effect
from vispeg.effects.common.servo_loop import ServoLoop
from vispeg.robots.model import RobotModel, load
from vispeg.sim.placement import Active, activate
from vispeg.sim.plant import Plant
from vispeg.sim.servo import reference_inertia, stable_step
from vispeg.worlds.world import World

HOOKS = ("drive", "torque", "friction", "observe", "wrench", "believe", "image", "start")  # not expressible in MJCF
MOTOR = ("torque_gain", "joint_bias", "torque_limit", "servo")
STEP = 1e-3  # s, default physics step
NUMBERS = {  # mjModel field -> kind of element and attribute, for fields that map one to one
    "dof_frictionloss": ("joint", "frictionloss"),
    "dof_armature": ("joint", "armature"),
    "dof_solref": ("joint", "solref_friction"),
    "dof_solimp": ("joint", "solimp_friction"),
    "dof_damping": ("joint", "damping"),
    "jnt_stiffness": ("joint", "stiffness"),
    "qpos_spring": ("joint", "springref"),
    "geom_friction": ("geom", "friction"),
    "geom_solref": ("geom", "solref"),
    "geom_solimp": ("geom", "solimp"),
    "geom_pos": ("geom", "pos"),
    "body_pos": ("body", "pos"),
    "body_quat": ("body", "quat"),
}
POLYNOMIAL = ("damping", "stiffness")  # attributes of which effects change the first coefficient alone
INERTIAL = ("body_mass", "body_ipos", "body_iquat", "body_inertia")
OPTIONS = ("opt.gravity", "opt.iterations")
QUAT = mujoco.mjtOrientation.mjORIENTATION_QUAT  # a file may state an orientation in another way, which wins
HELD = {*NUMBERS, *INERTIAL, *OPTIONS}  # mjModel fields that an MJCF can state


@dataclass(frozen=True)
class Exported:
    """An exported MJCF.

    Attributes:
        xml: the text; the files that it reads are named relative to its folder.
        native: effects that the text expresses.
        left_out: effects for which MuJoCo has no element.
        meshes: by its name in the text, the content of the file of a mesh, a height field, a skin or a texture.
    """

    xml: str
    native: tuple[EffectInstance, ...]
    left_out: tuple[EffectInstance, ...]
    meshes: dict[str, bytes]


def compiled_with(world: World, robot: RobotModel | None = None) -> tuple[mujoco.MjModel, tuple[EffectInstance, ...]]:
    """Compile a model with its native effects; also return the effects left out, see `to_mjcf`."""
    made = to_mjcf(world, "meshes", robot)
    return mujoco.MjModel.from_xml_string(made.xml, made.meshes), made.left_out


def to_mjcf(world: World, meshes: str = "meshes", robot: RobotModel | None = None, step: float = STEP) -> Exported:
    """Export an arm, or the scene around it, with a world's effects.

    Args:
        world: robot, tool and effects with values.
        meshes: folder for meshes and textures, next to the MJCF file.
        robot: the scene that has the effects' targets; by default the arm alone.
        step: physics step, s; smaller if servos need it.
    """
    robot = load(world.robot, tool=world.tool) if robot is None else robot
    native = tuple(e for e in world.effects if is_native(effect(e.effect)))
    spec = robot.spec()
    for name in sorted({e.effect for e in native if effect(e.effect).overrides("build")}):
        effect(name).build(spec, robot)
    native_world = World(world.robot, world.tool, tuple(e for e in native if e.effect not in MOTOR))
    plant = Plant(robot, [native_world], step, step, 1)
    _numbers(spec, plant)
    if any(e.effect == "servo" for e in native):  # joints without the effect have ideal servos
        step = min(step, stable_step(robot))
    motors = World(world.robot, world.tool, tuple(e for e in native if e.effect in MOTOR))
    _motors(spec, robot, {a.effect.name: a for a in activate(robot, [motors])})
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    files = _read_from(spec, meshes)
    spec.compile()
    left_out = tuple(e for e in world.effects if e not in native)
    return Exported(listed(left_out) + spec.to_xml(), native, left_out, files)


def is_native(kind: Effect) -> bool:
    """Return whether MJCF elements can express all of an effect."""
    if kind.name in MOTOR:
        return True
    written = bool(kind.writes) and set(kind.writes) <= HELD and kind.family not in OPTICAL
    return written and not any(kind.overrides(hook) for hook in HOOKS)


def _numbers(spec: mujoco.MjSpec, plant: Plant) -> None:
    """Write the model numbers that effects have changed to their elements."""
    model = plant.model

    def value(field: str) -> np.ndarray | None:
        rows = plant.batch.expanded(field)
        return None if rows is None else np.array(rows[0])

    spec.compile()  # elements get the same ids as in the plant's model, which has the same parts
    elements = {"joint": spec.joints, "geom": spec.geoms, "body": spec.bodies}
    for field, (kind, attribute) in NUMBERS.items():
        if (now := value(field)) is None:
            continue
        before = getattr(model, field)
        for element in elements[kind]:
            row = _row(model, field, element.id)
            if np.array_equal(now[row], before[row]):
                continue
            number = now[row]
            # the compiler moves a mesh to its centre, so add the effect's shift to the stated position
            if attribute == "pos":
                number = np.array(element.pos) + (now[row] - before[row])
            if attribute == "springref" and spec.compiler.degree:
                number = np.degrees(number)
            if attribute == "quat":
                element.alt.type = QUAT
            if attribute in POLYNOMIAL:
                number = [float(number), *getattr(element, attribute)[1:]]
            setattr(element, attribute, number)
    _inertials(spec, model, {field: value(field) for field in INERTIAL})
    if (gravity := value("opt.gravity")) is not None:
        spec.option.gravity = gravity.reshape(3)
    if (iterations := value("opt.iterations")) is not None:
        spec.option.iterations = int(np.ravel(iterations)[0])


def _row(model: mujoco.MjModel, field: str, i: int) -> int:
    """Return the row of a field that belongs to an element's id."""
    if field.startswith("dof_"):
        return int(model.jnt_dofadr[i])
    return int(model.jnt_qposadr[i]) if field.startswith("qpos_") else i


def _inertials(spec: mujoco.MjSpec, model: mujoco.MjModel, changed: dict[str, np.ndarray | None]) -> None:
    """Write mass, centre of mass and principal inertia of every body that an effect has changed."""
    for body in spec.bodies[1:]:
        i = model.body(body.name).id
        now = {f: getattr(model, f)[i] if rows is None else rows[i] for f, rows in changed.items()}
        if all(np.array_equal(x, getattr(model, f)[i]) for f, x in now.items()):
            continue
        body.explicitinertial = True
        body.mass, body.ipos, body.iquat = float(now["body_mass"]), now["body_ipos"], now["body_iquat"]
        body.ialt.type = QUAT
        body.inertia, body.fullinertia = now["body_inertia"], [np.nan, 0, 0, 0, 0, 0]


def _motors(spec: mujoco.MjSpec, robot: RobotModel, active: Mapping[str, Active]) -> None:
    """Write gain, bias and limit of each motor, and the loop of servos."""
    nj = len(robot.joints)

    def number(name: str, key: str, null: float) -> np.ndarray:
        return active[name].p[key][0] if name in active else np.full(nj, null)

    gain, bias = number("torque_gain", "gain", 1.0), number("joint_bias", "torque", 0.0)
    unlimited = effect("torque_limit").params["limit"].null
    limit = number("torque_limit", "limit", unlimited)
    asked, back = np.ones(nj), np.zeros((nj, 2))  # force = asked ctrl + back (q, dq)
    if "servo" in active:
        law, inertia = ServoLoop.ideal(1, nj), reference_inertia(robot)
        active["servo"].effect.regulate(law, active["servo"].p)
        stiffness = inertia * law.frequency[0] ** 2
        back = -np.stack([stiffness, 2.0 * inertia * law.damping[0] * law.frequency[0]], axis=1)
        asked = law.gain[0] * stiffness
    for j, name in enumerate(robot.joints):
        motor = spec.actuator(name)
        motor.gainprm[0] = gain[j] * asked[j]
        if bias[j] or back[j].any():
            motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            motor.biasprm[:3] = [bias[j], *(gain[j] * back[j])]
        if limit[j] < unlimited:
            motor.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            motor.forcerange = (bias[j] - limit[j], bias[j] + limit[j])


def _read_from(spec: mujoco.MjSpec, folder: str) -> dict[str, bytes]:
    """Let a spec read meshes, height fields, skins and textures from a folder; return {name in the text: content}."""
    home, meshes, textures = Path(spec.modelfiledir or "."), spec.meshdir or "", spec.texturedir or ""
    files: dict[str, bytes] = {}

    def placed(prefix: str, name: str, file: Path) -> str:
        at = free_name(f"{folder}/{prefix}", name or file.stem, file.suffix, files)
        files[at] = file.read_bytes()
        return at

    for group, base, prefix in (
        (spec.meshes, meshes, ""),
        (spec.hfields, meshes, "height-"),
        (spec.skins, meshes, "skin-"),
        (spec.textures, textures, "texture-"),
    ):
        for element in group:
            if element.file:
                element.file = placed(prefix, element.name, home / base / element.file)  # may be absolute
    for texture in spec.textures:
        for side, file in enumerate(texture.cubefiles):
            if file:
                texture.cubefiles[side] = placed("texture-", f"{texture.name}{side}", home / textures / file)
    spec.meshdir = spec.texturedir = ""
    spec.assets = {**spec.assets, **files}
    return files


def free_name(start: str, name: str, end: str, taken: Collection[str]) -> str:
    """Return the path `start` `name` `end`, numbered if it is taken.

    Slashes in a name become hyphens, as it comes from a user's file and must not lead to another folder.
    """
    plain = start + re.sub(r"[/\\]", "-", name)
    return next(path for k in count() if (path := f"{plain}-{k}{end}" if k else plain + end) not in taken)


def listed(left_out: tuple[EffectInstance, ...], who: str = "MuJoCo") -> str:
    """Return a comment that lists the effects missing in the file; "" if there are none."""
    lines = []
    for e in left_out:
        values = ", ".join(f"{k} {v.value:g} {effect(e.effect).params[k].unit}" for k, v in e.params.items())
        lines.append(f"  {e.label}: {values}".replace("--", "- -"))
    comment = "\n".join([f"Effects of the model that {who} has no element for:", *lines])
    return f"<!-- {comment} -->\n" if left_out else ""
