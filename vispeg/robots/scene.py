"""Scenes: an arm with its surroundings.

`build` makes the peg cell: arm, gripper, peg, fixture with a hole, table, background, lights and distractors.
`vispeg.robots.bench` makes the scene in a robot's own file.

The world frame of the peg cell is the robot's base, z up; the table's top is at z = 0. Each part has one material and
one texture, which randomized looks change. Shapes for contact are in geom group 3 and are never rendered.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any

import mujoco

from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.robots import furniture, gripper, hole, tools, user_cell
from vispeg.robots.declare import RobotConfig
from vispeg.robots.furniture import COLOURS, LIGHTS
from vispeg.robots.model import RobotModel, load
from vispeg.robots.scene_config import SceneConfig
from vispeg.robots.user_shapes import UserShape, UserThing

G = mujoco.mjtGeom
GRIP = 120.0  # N, friction that holds the peg between the fingers (a Schunk MEG 50 closes with up to 100 N per finger)
OURS = {*COLOURS, "finger_left", "finger_right", "peg_tip", "peg_slip", "hole", "wrench"}  # names that the cell uses
CAMERAS = ("wrist_wide", "wrist_crop", "external")
FIXTURE = "fixture"  # the body that may be mounted on springs
PEG_IN_HOLE: dict[str, Any] = {
    "goal": "hole",
    "tip_site": "peg_tip",
    "wall": hole.WALL,
    "plate": hole.PLATE,
    "top": hole.TOP,
    "held": "peg",
    "fixture": FIXTURE,
    "offset": "hole_offset",
    "tilt": "hole_tilt",
    "slip": "peg_slip",
}
POSED = ("peg_tip", "hole"), ("fixture", "peg")  # sites and bodies of the peg cell whose poses are labels


@dataclass(frozen=True, eq=False)
class Scene(RobotModel):
    """A robot with its surroundings: a RobotModel, and everything that a camera sees.

    A scene with a task also describes the held part and the goal. A scene without a task leaves these attributes empty.

    Attributes:
        nominal: the arm with its tool alone, as the controller knows it.
        parts: by name of each visible part, its geom names.
        things: bodies whose pose is known only roughly: objects in the scene, and the held part.
        dressed: parts that have a material of the part's name, which looks change.
        lights, cameras: names of lights and cameras.
        config: configuration of the cell; None without a task.
        tip: distance of the held part's tip from the flange along the flange's z axis, m.
        target: nominal position of the goal, base frame, m.
        goal, tip_site: names of the sites that the task brings together; the z axes of both are along the insertion.
        wall, plate: prefixes of the names of the goal's geoms, around its mouth and beside it.
        top: name of one geom that replaces all of these except for the mouth; it has contact only if a contact
            diagnosis enables it.
        held, fixture: names of the body that the gripper holds, and of the body that the goal is part of.
        offset, tilt: names of the effects that shift and turn the goal, to the fixture's true pose.
        slip: name of the slide joint of the held part in the gripper; empty if it cannot slip.
        stated: effects that the cell states: pictures show them unless a world has others at the same places.
    """

    nominal: RobotModel = field(kw_only=True)
    parts: dict[str, tuple[str, ...]] = field(default_factory=dict)
    things: tuple[str, ...] = ()
    dressed: tuple[str, ...] = ()
    lights: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()
    config: SceneConfig = field(default=None)  # type: ignore[assignment]  # only asked for with a task
    tip: float = 0.0
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    goal: str = ""
    tip_site: str = ""
    wall: str = ""
    plate: str = ""
    top: str = ""
    held: str = ""
    fixture: str = ""
    offset: str = ""
    tilt: str = ""
    slip: str = ""
    stated: tuple[EffectInstance, ...] = ()

    @property
    def posed(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the sites and of the bodies whose poses are labels of a picture."""
        return tuple(s for s in (self.tip_site, self.goal) if s), self.things


def build(config: SceneConfig | None = None, cameras: tuple[str, ...] = CAMERAS) -> Scene:
    """Build the peg cell of a configuration; equal configurations return the same object until a file is edited.

    Args:
        config: the configuration; default: `SceneConfig()`.
        cameras: names of the cell's cameras, which are the places of camera effects.

    Raises:
        UserError: the geometry is impossible, or a mesh file or the robot cannot be used.
    """
    config = config or SceneConfig()
    arm = load(config.robot.model, declared=config.robot)
    stamps = arm, gripper.stamp(config.robot.tool)  # an edited file is read again
    return _build(config, cameras, stamps, *user_cell.shapes(config, config.robot.tool), user_cell.things(config))


@lru_cache(maxsize=32)
def _build(
    config: SceneConfig,
    cameras: tuple[str, ...],
    stamps: tuple[RobotModel, tuple[int, ...]],
    peg: UserShape | None,
    block: UserShape | None,
    things: tuple[UserThing, ...],
) -> Scene:
    _check_names(config.robot)
    config = user_cell.placed(config, block)
    arm = user_cell.arm_with(config.robot, f"peg{round(config.diameter * 1000)}")
    tip = user_cell.grasp(config, config.robot.tool) + tools.PEG_LENGTH
    if peg is not None:
        arm, tip = user_cell.hold(config, config.robot, peg)
    spec = arm.spec()
    furniture.options(spec)
    for group in (spec.lights, spec.cameras):  # remove those of the robot's file, as the cell has its own
        for element in list(group):
            spec.delete(element)
    for part, colour in COLOURS.items():
        furniture.material(spec, part, colour)
    parts = {"arm": visible(spec)}
    parts |= _gripper_and_peg(spec, config)
    parts |= _fixture(spec, config, block)
    parts |= furniture.room(spec, things)
    furniture.lights(spec)
    _sensors(spec)
    base: dict[str, Any] = {f.name: getattr(arm, f.name) for f in fields(RobotModel)}
    extra: dict[str, Any] = {
        "config": config,
        "nominal": arm,  # a square peg is declared with the mass and inertia of the round peg of the same size
        "parts": parts,
        "cameras": cameras,
        "tip": tip,
        "target": config.fixture,
    }
    seen: dict[str, Any] = {"things": ("fixture", "peg"), "dressed": tuple(parts), "lights": tuple(LIGHTS)}
    return Scene(**{**base, "build": spec.copy}, **extra, **seen, **PEG_IN_HOLE)


def _check_names(robot: RobotConfig) -> None:
    """Raise UserError if an element of the robot has a name that the cell uses."""
    spec = load(robot.model, declared=robot).spec()
    _warn_of_flange(spec, robot)
    for kind in ("bodies", "geoms", "sites", "joints", "materials", "textures", "meshes"):
        for element in getattr(spec, kind):
            if element.name in OURS:
                what = f"the robot has a part named '{element.name}', a name that the cell uses"
                expected = "another name in the robot's file, or a model without `cell`: its scene is the file's own"
                raise UserError(what, file=robot.model, key=kind, expected=expected)


def _warn_of_flange(spec: mujoco.MjSpec, robot: RobotConfig) -> None:
    """Warn if the tool is fixed to the last link's origin although the file has frames further out."""
    link = spec.site("flange").parent
    still = list(spec.site("flange").pos) == [0.0, 0.0, 0.0] and len(link.joints) > 0
    further = [b.name for b in link.bodies if any(b.pos) and not len(b.joints) and b.name not in ("", "tool")]
    further += [s.name for s in link.sites if any(s.pos) and s.name not in ("", "flange")]
    if still and further and not robot.flange:
        what = f"the tool is fixed in the origin of {link.name}; `flange` in the world's `robot` may name another frame"
        note(f"{robot.model}: {what}: {', '.join(further)}")


def visible(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the names of the arm's visible geoms without those of the tool; geoms without a name get one.

    Files differ in the geom group of shapes for contact. If a body has shapes without contact, only these are taken as
    visible, and the others are moved to group 3.
    """
    tool = spec.body("tool")
    held = {g.name for body in ((tool, *tool.bodies) if tool else ()) for g in body.geoms}
    seen = [g for g in spec.geoms if g.group < 3 and g.parent.name != "world" and g.name not in held - {""}]
    drawn = {g.parent.name for g in seen if not (g.contype or g.conaffinity)}
    for geom in seen:
        if geom.parent.name in drawn and (geom.contype or geom.conaffinity):
            geom.group = 3
    seen = [g for g in seen if g.group < 3]
    for i, geom in enumerate(seen):
        geom.name = geom.name or f"arm{i}"
    return tuple(g.name for g in seen)


def _gripper_and_peg(spec: mujoco.MjSpec, config: SceneConfig) -> dict[str, tuple[str, ...]]:
    """Set the colours of gripper and peg, the peg's contact and the joint along which it can slip; return the parts."""
    gripper = tuple(geom.name for geom in spec.body("tool").geoms if geom.group < 3)
    for name in gripper:
        spec.geom(name).material = "gripper"
        spec.geom(name).rgba = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's default, with which the material's colour is drawn
    peg, body = spec.geom("peg"), spec.body("peg")
    if config.shape == "square" and not config.peg_mesh:
        r, half = peg.size[0], peg.size[1]
        peg.type, peg.size = G.mjGEOM_BOX, (r, r, half)
    peg.material, peg.rgba, peg.group = "peg", (0.5, 0.5, 0.5, 1.0), 0
    for geom in body.geoms:
        geom.friction = (config.friction, 0.002, 1e-5)
        geom.solref, geom.solimp = config.solref, (0.95, 0.99, 2e-4, 0.5, 2.0)
        geom.condim, geom.priority = 3, 1
    slip = body.add_joint(name="peg_slip", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 0, 1), damping=50.0)
    slip.frictionloss = GRIP
    slip.solref_friction, slip.solimp_friction = (0.002, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)  # see `physics.firm`
    return {"gripper": gripper, "peg": ("peg",)}


def _fixture(spec: mujoco.MjSpec, config: SceneConfig, block: UserShape | None) -> dict[str, tuple[str, ...]]:
    """Add the fixture with its hole, built in or from a file (`block`); return the visible geoms' names by part."""
    visual = {"contype": 0, "conaffinity": 0, "material": "fixture"}
    n = 4 if config.shape == "square" else hole.sides(config.apothem)
    body = spec.worldbody.add_body(name="fixture", pos=config.fixture)
    body.add_site(name="hole", group=4)
    if block is not None:
        block.add(spec, body, "fixture", lambda x: x, hole.CONTACT, {"material": "fixture"})
        return {"fixture": ("fixture",)}
    shape = n, config.apothem, config.block, config.depth, config.chamfer
    hole.add_walls(spec, body, *shape)
    vertices, faces = hole.visual(*shape)
    spec.add_mesh(
        name="fixture",
        uservert=vertices.ravel().tolist(),
        userface=faces.ravel().tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    body.add_geom(name="fixture", type=G.mjGEOM_MESH, meshname="fixture", **visual)
    return {"fixture": ("fixture",)}


def _sensors(spec: mujoco.MjSpec) -> None:
    """Add sensors: the wrench between flange and tool in the flange frame (N, N m), and the net contact force of the
    tool with its peg on what it touches (world frame, N).
    """
    spec.body("tool").add_site(name="wrench", group=4)
    for name, kind in (("force", mujoco.mjtSensor.mjSENS_FORCE), ("torque", mujoco.mjtSensor.mjSENS_TORQUE)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="wrench")
    # bits of mjtConDataField, the reduction that sums contacts to a net force, and the number of results
    exists, force, net, count = 1, 2, 3, 1
    spec.add_sensor(
        name="contact",
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,
        objname="tool",
        intprm=[exists | force, net, count],
    )
