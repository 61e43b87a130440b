"""Scenes: an arm and what stands around it. `build` makes the peg cell: arm, gripper, peg, fixture with a hole, table,
background, lights and places for distractors; `vispeg.robots.bench` makes the scene that a robot's own file shows.

World frame of the peg cell: the robot's base, z up; the table's top is z = 0. Parts share a material and a texture of
their own, which is what randomized looks write into. Shapes for contact are in group 3 and are never rendered.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any

import mujoco

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.robots import furniture, hole, tools, user_cell
from vispeg.robots.declare import RobotConfig
from vispeg.robots.furniture import COLOURS, LIGHTS
from vispeg.robots.hole import TOUCHED, UNTOUCHED
from vispeg.robots.model import RobotModel, load
from vispeg.robots.scene_config import SceneConfig
from vispeg.robots.user_shapes import UserShape, UserThing

G = mujoco.mjtGeom
GRIP = 120.0  # N, friction that holds the peg between the fingers (a Schunk MEG 50 closes with up to 100 N a finger)
OURS = {*COLOURS, "finger_left", "finger_right", "peg_tip", "peg_slip", "hole", "wrench"}  # names in the cell
CAMERAS = ("wrist_wide", "wrist_crop", "external")
FIXTURE = "fixture"  # the body of a cell that may stand on springs
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
POSED = ("peg_tip", "hole"), ("fixture", "peg")  # sites and bodies of the peg cell that labels give the poses of


@dataclass(frozen=True, eq=False)
class Scene(RobotModel):
    """A robot and what stands around it: everything a RobotModel is, and what a camera sees.

    A scene with a task also says what the arm holds and where that goes. A scene without one leaves all of that empty.

    Attributes:
        nominal: the arm with what it carries alone: what a controller knows.
        parts: geom names of each part that can be seen.
        things: bodies whose place nobody knows exactly: what stands about, what the gripper holds.
        dressed: parts with a material of their own name, which looks write into.
        lights, cameras: names.
        config: of the task's shapes; None without a task.
        tip: height of the tip below the flange, m.
        target: nominal place of the goal, base frame, m.
        goal, tip_site: names of the sites that the task brings together, z of both along the way in.
        wall, plate: what names of the goal's pieces begin with: around its mouth, and beside it.
        top: geom that is all of them without the mouth; touched only where a diagnosis of contact says so.
        held, fixture: bodies of what the gripper holds and of what the goal is part of.
        offset, tilt: effects that move the goal and turn it: where the fixture really stands.
        slip: slide joint of the held part in the gripper; "" where it cannot slip.
    """

    nominal: RobotModel = field(default=None)  # type: ignore[assignment]
    parts: dict[str, tuple[str, ...]] = field(default_factory=dict)
    things: tuple[str, ...] = ()
    dressed: tuple[str, ...] = ()
    lights: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()
    config: SceneConfig = field(default=None)  # type: ignore[assignment]
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

    @property
    def posed(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Sites and bodies whose poses belong to a picture's labels."""
        return tuple(s for s in (self.tip_site, self.goal) if s), self.things


def build(config: SceneConfig | None = None, cameras: tuple[str, ...] = CAMERAS) -> Scene:
    """Give the cell for a configuration; equal configurations give the same object.

    Args:
        config: its geometry; by default the default cell.
        cameras: names of those that stand in it, which effects of cameras find as their places.

    Raises:
        UserError: geometry that cannot be, mesh files that cannot be used.
    """
    config = config or SceneConfig()
    return _build(config, cameras, *user_cell.shapes(config, config.robot.tool), user_cell.things(config))


@lru_cache(maxsize=32)
def _build(
    config: SceneConfig,
    cameras: tuple[str, ...],
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
    for group in (spec.lights, spec.cameras):  # of the robot's file: the cell has its own
        for element in list(group):
            spec.delete(element)
    for part, colour in COLOURS.items():
        furniture.material(spec, part, colour)
    parts = {"arm": visible(spec)}
    parts |= _hand(spec, config)
    parts |= _fixture(spec, config, block)
    parts |= furniture.room(spec, things)
    furniture.lights(spec)
    _sensors(spec)
    base: dict[str, Any] = {f.name: getattr(arm, f.name) for f in fields(RobotModel)}
    # a square peg is declared with its round sister's mass and inertia
    extra: dict[str, Any] = {
        "config": config,
        "nominal": arm,
        "parts": parts,
        "cameras": cameras,
        "tip": tip,
        "target": config.fixture,
    }
    seen: dict[str, Any] = {"things": ("fixture", "peg"), "dressed": tuple(parts), "lights": tuple(LIGHTS)}
    return Scene(**{**base, "build": spec.copy}, **extra, **seen, **PEG_IN_HOLE)


def _check_names(robot: RobotConfig) -> None:
    """Raise UserError for a robot with a part of a name that the cell gives to one of its own."""
    spec = load(robot.model, declared=robot).spec()
    _say_flange(spec, robot)
    for kind in ("bodies", "geoms", "sites", "joints", "materials", "textures", "meshes"):
        for element in getattr(spec, kind):
            if element.name in OURS:
                what = f"the robot has a part named '{element.name}', as the cell has"
                expected = "another name in the robot's file, or a model without `cell`: its scene is the file's own"
                raise UserError(what, file=robot.model, key=kind, expected=expected)


def _say_flange(spec: mujoco.MjSpec, robot: RobotConfig) -> None:
    """Warns where the tool is fixed in the last link's origin, and the file has other frames further out."""
    link = spec.site("flange").parent
    still = list(spec.site("flange").pos) == [0.0, 0.0, 0.0] and len(link.joints) > 0
    further = [b.name for b in link.bodies if any(b.pos) and not len(b.joints) and b.name not in ("", "tool")]
    further += [s.name for s in link.sites if any(s.pos) and s.name not in ("", "flange")]
    if still and further and not robot.flange:
        what = f"the tool is fixed in the origin of {link.name}; `flange` in the world's `robot` may name another frame"
        note(f"{robot.model}: {what}: {', '.join(further)}")


def visible(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Names of the arm's geoms that are seen, without its tool's; those without a name get one.

    Files differ in the group of their shapes for contact: in a body with shapes that do not collide, the others are.
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


def _hand(spec: mujoco.MjSpec, config: SceneConfig) -> dict[str, tuple[str, ...]]:
    """Colours gripper and peg, gives the peg its contact and the joint along which it can slip."""
    gripper = tuple(geom.name for geom in spec.body("tool").geoms if geom.group < 3)
    for name in gripper:
        spec.geom(name).material = "gripper"
        spec.geom(name).rgba = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's default: the material's colour shows
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
    """Wrench between flange and tool in the flange frame (N, N m), and the net contact force of the tool, peg included,
    on what it touches (world, N).
    """
    spec.body("tool").add_site(name="wrench", group=4)
    for name, kind in (("force", mujoco.mjtSensor.mjSENS_FORCE), ("torque", mujoco.mjtSensor.mjSENS_TORQUE)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="wrench")
    exists, force, net = 1, 2, 3  # bits of what is reported; mjtConDataField and the reduction of the net force
    spec.add_sensor(
        name="contact",
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,
        objname="tool",
        intprm=[exists | force, net, 1],
    )


__all__ = ["CAMERAS", "LIGHTS", "TOUCHED", "UNTOUCHED", "Scene", "SceneConfig", "build"]
