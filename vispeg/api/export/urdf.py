"""Write a world's arm as URDF: links, shapes, joints with limits, damping, dry friction and linear couplings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as xml

import mujoco
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation
from trimesh.exchange.stl import export_stl

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.report.live.shapes import rgba_of, visible
from vispeg.robots.model import GRAVITY, RobotModel, load
from vispeg.robots.solids import solid
from vispeg.sim.export import compiled_with, free_name, is_native, listed
from vispeg.worlds.world import World

# fields of the MuJoCo model that a URDF can express
HOLDS = {"dof_frictionloss", "dof_damping", "body_mass", "body_ipos", "body_iquat", "body_inertia"}
KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): "revolute", int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic"}
G = mujoco.mjtGeom
SHAPES = ("mesh", "box", "sphere", "cylinder", "capsule", "ellipsoid")  # that URDF has, the last two in other words
SECTIONS = 64  # sides of an ellipsoid around, which then is 0.1 % too thin between its corners


@dataclass(frozen=True)
class Urdf:
    """A URDF, and what it leaves out.

    Attributes:
        xml: the text; mesh files are named relative to its folder.
        native: effects that are included.
        left_out: effects that URDF has no element for.
        rotors: joint -> rotor inertia of the model, kg m2, which URDF has no element for.
        lacking: what else of the model URDF has no element for, such as `springs of joint1`.
        meshes: path in the text -> content of the mesh file.
        collides: whether any shape of the model collides; else the URDF has no <collision>.
    """

    xml: str
    native: tuple[EffectInstance, ...]
    left_out: tuple[EffectInstance, ...]
    rotors: Mapping[str, float]
    lacking: tuple[str, ...]
    meshes: Mapping[str, bytes]
    collides: bool


@dataclass(frozen=True)
class _Mesh:
    """A mesh as a file, and the pose in it of the frame that MuJoCo compiles it to.

    Attributes:
        file: its path in the text.
        stl: the content.
        pos, turn: the pose, m.
    """

    file: str
    stl: bytes
    pos: np.ndarray
    turn: Rotation


def fits(placed: EffectInstance) -> bool:
    """Return whether a URDF can express an effect completely."""
    kind = effect(placed.effect)
    return is_native(kind) and bool(kind.writes) and set(kind.writes) <= HOLDS


def to_urdf(world: World, meshes: str = "meshes") -> Urdf:
    """Return the URDF of a world's arm with its effects.

    Args:
        world: robot, tool and effects with values.
        meshes: name of the folder for the meshes, beside the URDF.

    Raises:
        UserError: a body with several joints, or a joint that neither turns nor slides.
    """
    robot = load(world.robot, tool=world.tool)
    native = tuple(e for e in world.effects if fits(e))
    model, _ = compiled_with(World(world.robot, world.tool, native))
    plain = robot.compile()
    root, shift = xml.Element("robot", name=Path(world.robot).stem), _anchors(model)
    mimics = _mimics(model)
    links = [xml.SubElement(root, "link", name=_name(model, b)) for b in range(model.nbody)]
    for b in np.flatnonzero(model.body_mass > 0).tolist():
        _inertial(links[b], model, b, shift[b])
    roles = _roles(plain)
    files = _meshes(plain, [g for geoms in roles.values() for g in geoms], meshes)
    for role, geoms in roles.items():
        for g in geoms:
            b = model.body(plain.body(plain.geom_bodyid[g]).name).id
            for shape, pos, quat in _geometries(plain, g, files):
                element = xml.SubElement(links[b], role)
                _origin(element, pos - shift[b], quat)
                element.append(shape)
                if role == "visual":
                    _material(element, plain, g)
    for b in range(1, model.nbody):
        _joint(root, model, robot, b, shift, mimics)
    _flange(root, model, robot.flange, shift)
    left_out = tuple(e for e in world.effects if e not in native)
    rotors = {n: float(a) for n in robot.joints if (a := model.dof_armature[model.joint(n).dofadr[0]]) > 0}
    xml.indent(root)
    contents = {mesh.file: mesh.stl for mesh in files.values()}
    text = '<?xml version="1.0"?>\n' + listed(left_out, "URDF") + xml.tostring(root, encoding="unicode") + "\n"
    return Urdf(
        text, native, left_out, rotors, _lacking(model, plain, roles, mimics), contents, bool(roles["collision"])
    )


def _mimics(model: mujoco.MjModel) -> dict[int, int]:
    """Return joint -> the equality that makes it a linear function of another, which URDF holds; one for each joint."""
    out: dict[int, int] = {}
    for i in np.flatnonzero(model.eq_active0):
        linear = model.eq_type[i] == mujoco.mjtEq.mjEQ_JOINT and not model.eq_data[i, 2:5].any()
        if linear and model.eq_obj2id[i] >= 0:
            out.setdefault(int(model.eq_obj1id[i]), int(i))
    return out


def _lacking(
    model: mujoco.MjModel, plain: mujoco.MjModel, roles: Mapping[str, list[int]], mimics: Mapping[int, int]
) -> tuple[str, ...]:
    """Return the features of `model` that URDF has no element for; shapes are those of `plain`, without effects."""
    joints = [model.joint(j).name for j in range(model.njnt)]
    sprung = (model.jnt_stiffness > 0) | model.jnt_stiffnesspoly.any(axis=1)
    curved = model.dof_dampingpoly[model.jnt_dofadr].any(axis=1)
    shown = [g for geoms in roles.values() for g in geoms]
    named = {
        "springs of": [name for name, there in zip(joints, sprung, strict=True) if there],
        "damping that grows with speed of": [name for name, there in zip(joints, curved, strict=True) if there],
        "couplings": [
            model.equality(i).name or f"equality{i + 1}"
            for i in np.flatnonzero(model.eq_active0)
            if i not in mimics.values()
        ],
        "tendons": [model.tendon(i).name or f"tendon{i + 1}" for i in range(model.ntendon)],
        "shapes": sorted({G(int(k)).name.removeprefix("mjGEOM_").lower() for k in plain.geom_type[shown]} - {*SHAPES}),
    }
    out = [f"{what} {', '.join(names)}" for what, names in named.items() if names]
    if not np.allclose(model.opt.gravity, (0, 0, -GRAVITY)):
        out.append(f"gravity of {_numbers(model.opt.gravity)} m/s^2")
    if model.opt.density or model.opt.viscosity:
        out.append(f"a medium of {model.opt.density:g} kg/m^3 and {model.opt.viscosity:g} Pa s")
    return tuple(out)


def _anchors(model: mujoco.MjModel) -> np.ndarray:
    """Return the offsets (nbody, 3), m, from each body's frame to its link's frame, which must lie on the joint axis.

    Raises:
        UserError: a body with several joints, or a joint that neither turns nor slides.
    """
    for b in range(model.nbody):
        kinds = [int(model.jnt_type[j]) for j in range(model.njnt) if model.jnt_bodyid[j] == b]
        if len(kinds) > 1 or any(kind not in KINDS for kind in kinds):
            got = f"{len(kinds)} joints" if len(kinds) > 1 else str(mujoco.mjtJoint(kinds[0]))
            raise UserError("has no URDF", key=_name(model, b), expected="at most one hinge or slide a body", got=got)
    out = np.zeros((model.nbody, 3))
    out[model.jnt_bodyid] = model.jnt_pos
    return out


def _name(model: mujoco.MjModel, b: int) -> str:
    return model.body(b).name or f"body{b}"


def _origin(parent: xml.Element, pos: np.ndarray, quat: np.ndarray) -> None:
    rpy = Rotation.from_quat(quat, scalar_first=True).as_euler("xyz")
    xml.SubElement(parent, "origin", xyz=_numbers(pos), rpy=_numbers(rpy))


def _flange(root: xml.Element, model: mujoco.MjModel, name: str, shift: np.ndarray) -> None:
    """Add a link without mass at the site `name`, the flange, unless a link has its name."""
    if any(link.get("name") == name for link in root.iterfind("link")):
        return
    site = model.site(name)
    b = int(site.bodyid[0])
    xml.SubElement(root, "link", name=name)
    joint = xml.SubElement(root, "joint", name=f"{name}_fixed", type="fixed")
    _origin(joint, site.pos - shift[b], site.quat)
    xml.SubElement(joint, "parent", link=_name(model, b))
    xml.SubElement(joint, "child", link=name)


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{float(v):.12g}" for v in values)


def _inertial(link: xml.Element, model: mujoco.MjModel, b: int, shift: np.ndarray) -> None:
    inertial = xml.SubElement(link, "inertial")
    _origin(inertial, model.body_ipos[b] - shift, np.array([1.0, 0.0, 0.0, 0.0]))
    xml.SubElement(inertial, "mass", value=f"{model.body_mass[b]:.12g}")
    turn = Rotation.from_quat(model.body_iquat[b], scalar_first=True).as_matrix()
    full = turn @ np.diag(model.body_inertia[b]) @ turn.T
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    xml.SubElement(inertial, "inertia", {name: f"{full[at]:.12g}" for name, at in names.items()})


def _roles(model: mujoco.MjModel) -> dict[str, list[int]]:
    """Return by element of a URDF the geoms that it stands for: what is drawn, and what collides."""
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return {"visual": visible(model), "collision": np.flatnonzero(collides).tolist()}


def _material(visual: xml.Element, model: mujoco.MjModel, g: int) -> None:
    """Add the colour of geom `g`; materials of one name are one to readers, so the name is the colour."""
    rgba = _numbers(np.array(rgba_of(model, g)))
    material = xml.SubElement(visual, "material", name="rgba_" + rgba.replace(" ", "_"))
    xml.SubElement(material, "color", rgba=rgba)


def _geometries(
    model: mujoco.MjModel, g: int, meshes: Mapping[int, _Mesh]
) -> list[tuple[xml.Element, np.ndarray, np.ndarray]]:
    """Return each `<geometry>` of geom `g` and its pose in the body; none for a kind that URDF cannot express.

    A capsule is a cylinder and two spheres, an ellipsoid a mesh.
    """
    kind, size = model.geom_type[g], model.geom_size[g]
    pos, quat = model.geom_pos[g], model.geom_quat[g]
    turn = Rotation.from_quat(quat, scalar_first=True)
    radius, length = f"{size[0]:.12g}", f"{2 * size[1]:.12g}"
    ends = turn.apply([[0.0, 0.0, size[1]], [0.0, 0.0, -size[1]]])
    if g in meshes:
        mesh = meshes[g]
        back = turn * mesh.turn.inv()
        return [(_shape("mesh", filename=mesh.file), pos - back.apply(mesh.pos), back.as_quat(scalar_first=True))]
    if kind == G.mjGEOM_BOX:
        return [(_shape("box", size=_numbers(2 * size)), pos, quat)]
    if kind == G.mjGEOM_SPHERE:
        return [(_shape("sphere", radius=radius), pos, quat)]
    if kind == G.mjGEOM_CYLINDER:
        return [(_shape("cylinder", radius=radius, length=length), pos, quat)]
    if kind == G.mjGEOM_CAPSULE:
        caps = [(_shape("sphere", radius=radius), pos + end, quat) for end in ends]
        return [(_shape("cylinder", radius=radius, length=length), pos, quat), *caps]
    return []


def _shape(kind: str, **sizes: str) -> xml.Element:
    geometry = xml.Element("geometry")
    xml.SubElement(geometry, kind, sizes)
    return geometry


def _meshes(model: mujoco.MjModel, geoms: Iterable[int], folder: str) -> dict[int, _Mesh]:
    """Return the STL that stands for each of `geoms` that is a mesh or an ellipsoid, by geom.

    Vertices of meshes are the compiled ones, since a URDF states neither a mesh's reference pose nor other formats than
    STL that every reader has; they are moved back to the origin of the file, from where the compiler moves them to the
    centre of mass and the principal axes.
    """
    made: dict[int, _Mesh] = {}
    of_mesh: dict[int, _Mesh] = {}
    for g in sorted(set(geoms), key=lambda g: (int(model.geom_dataid[g]), g)):
        kind, m = G(int(model.geom_type[g])), int(model.geom_dataid[g])
        surface = solid(model, g, SECTIONS) if kind in (G.mjGEOM_MESH, G.mjGEOM_ELLIPSOID) else None
        if surface is None:
            continue
        if m in of_mesh:
            made[g] = of_mesh[m]
            continue
        vertices, faces = surface
        turn, pos, name = Rotation.identity(), np.zeros(3), f"{_name(model, int(model.geom_bodyid[g]))}-ellipsoid"
        if kind == G.mjGEOM_MESH:
            turn, pos = Rotation.from_quat(model.mesh_quat[m], scalar_first=True), model.mesh_pos[m]
            name = model.mesh(m).name
        file = free_name(f"{folder}/", name, ".stl", [mesh.file for mesh in made.values()])
        stl = export_stl(trimesh.Trimesh(turn.apply(vertices) + pos, faces, process=False))
        made[g] = _Mesh(file, stl, pos, turn)
        if kind == G.mjGEOM_MESH:
            of_mesh[m] = made[g]
    return made


def _joint(
    root: xml.Element, model: mujoco.MjModel, robot: RobotModel, b: int, shift: np.ndarray, mimics: Mapping[int, int]
) -> None:
    """Add the joint between body `b` and its parent; `shift` as by `_anchors`, `mimics` as by `_mimics`."""
    parent = int(model.body_parentid[b])
    moved = [j for j in range(model.njnt) if model.jnt_bodyid[j] == b]
    kind = KINDS[int(model.jnt_type[moved[0]])] if moved else "fixed"
    limited = bool(moved) and bool(model.jnt_limited[moved[0]])
    name = model.joint(moved[0]).name if moved else f"{_name(model, b)}_fixed"
    kind = "continuous" if kind == "revolute" and not limited else kind
    joint = xml.SubElement(root, "joint", name=name, type=kind)
    turn = Rotation.from_quat(model.body_quat[b], scalar_first=True)
    anchor = model.body_pos[b] + turn.apply(shift[b]) - shift[parent]
    for j in moved:  # the pose of the file holds at the joint's reference, that of a URDF at 0
        turn *= Rotation.from_rotvec(-model.qpos0[model.jnt_qposadr[j]] * model.jnt_axis[j])
    _origin(joint, anchor, turn.as_quat(scalar_first=True))
    xml.SubElement(joint, "parent", link=_name(model, parent))
    xml.SubElement(joint, "child", link=_name(model, b))
    if not moved:
        return
    j, dof = moved[0], int(model.jnt_dofadr[moved[0]])
    xml.SubElement(joint, "axis", xyz=_numbers(model.jnt_axis[j]))
    values = {"damping": model.dof_damping[dof], "friction": model.dof_frictionloss[dof]}
    xml.SubElement(joint, "dynamics", {key: f"{value:.12g}" for key, value in values.items()})
    low, high = model.jnt_range[j] if limited else (-np.pi, np.pi)
    place = robot.joints.index(name) if name in robot.joints else None
    most = {"effort": robot.torque_limit, "velocity": robot.velocity_limit}
    # 0 stands for an unknown limit, as `vispeg.robots.urdf` reads it
    limits = {key: 0.0 if place is None or not np.isfinite(v[place]) else float(v[place]) for key, v in most.items()}
    xml.SubElement(joint, "limit", {k: f"{v:.12g}" for k, v in {"lower": low, "upper": high, **limits}.items()})
    if j in mimics:
        followed, offset, factor = model.eq_obj2id[mimics[j]], *model.eq_data[mimics[j], :2]
        own, other = model.qpos0[model.jnt_qposadr[[j, followed]]]  # MuJoCo couples the deviations from these angles
        line = {"multiplier": f"{factor:.12g}", "offset": f"{own + offset - factor * other:.12g}"}
        xml.SubElement(joint, "mimic", {"joint": model.joint(int(followed)).name, **line})
