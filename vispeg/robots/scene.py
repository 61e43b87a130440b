"""The cell: arm, gripper, peg, fixture with a hole, table, background, lights and places for distractors.

World frame: the robot's base, z up; the table's top is z = 0. Parts share a material and a texture of their own, which
is what randomized looks write into; shapes for contact are in group 3 and are never rendered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from functools import lru_cache

import mujoco

from vispeg.core.errors import UserError
from vispeg.robots import hole, tools, user_cell
from vispeg.robots.model import RobotModel, load
from vispeg.robots.user_shapes import UserShape

G = mujoco.mjtGeom
CONTACT = {"contype": 1, "conaffinity": 0}
TEXTURE = 128  # px, every part's texture
GRIP = 120.0  # N, friction that holds the peg between the fingers (a Schunk MEG 50 closes with up to 100 N a finger)
CAMERAS = ("wrist_wide", "wrist_crop", "external")
SHAPES = (G.mjGEOM_BOX, G.mjGEOM_CYLINDER, G.mjGEOM_SPHERE, G.mjGEOM_CAPSULE, G.mjGEOM_ELLIPSOID)
COLOURS = {
    "peg": (0.62, 0.64, 0.67),
    "fixture": (0.30, 0.38, 0.50),
    "table": (0.72, 0.66, 0.58),
    "floor": (0.45, 0.45, 0.47),
    "wall": (0.80, 0.81, 0.80),
    "gripper": (0.30, 0.31, 0.33),
    "distractors": (0.7, 0.5, 0.3),
}
# position, direction of each light in m; the first two are on
LIGHTS = {
    "key": ((0.2, -0.8, 1.6), (0.3, 0.6, -1.0)),
    "fill": ((0.4, 0.9, 1.5), (0.1, -0.6, -1.0)),
    "side": ((1.2, 0.2, 1.2), (-0.6, 0.0, -1.0)),
    "back": ((-0.5, 0.0, 1.8), (0.8, 0.0, -1.0)),
}


@dataclass(frozen=True)
class SceneConfig:
    """What the cell is built from; lengths in m unless named otherwise.

    Attributes:
        clearance_mm: diameter of the hole less diameter of the peg (for a square: width less width), mm.
        shape: `round` or `square`.
        diameter: of the peg (its width, if square).
        depth: of the hole.
        chamfer: of the hole's mouth, at 45 deg.
        friction: sliding friction of the peg in the hole.
        fixture: position of the centre of the hole's mouth, base frame.
        block: half the width of the fixture.
        solref: time constant (s) and damping ratio of the peg's contacts.
        peg_mesh, hole_mesh: mesh files instead of the built-in shapes, see `vispeg.robots.user_shapes`; a fixture
            from a file stands on the table at its `fixture`'s x and y.
        mesh_scale: m per unit of these files.
        mesh_concavity: how finely meshes that are not convex are taken apart (CoACD's threshold; smaller is finer).
        hole_origin: centre of the hole's mouth in its file's units; if empty, the middle of its top.
        peg_density: of a peg from a file, kg/m^3.
    """

    clearance_mm: float = 3.0
    shape: str = "round"
    diameter: float = 0.016
    depth: float = 0.025
    chamfer: float = 0.001
    friction: float = 0.3
    fixture: tuple[float, float, float] = (0.6, 0.0, 0.05)
    block: float = 0.05
    solref: tuple[float, float] = (0.003, 1.0)
    peg_mesh: str = ""
    hole_mesh: str = ""
    mesh_scale: float = 1.0
    mesh_concavity: float = 0.02
    hole_origin: tuple[float, ...] = ()
    peg_density: float = tools.STEEL

    def __post_init__(self) -> None:
        if self.shape not in ("round", "square"):
            raise UserError("unknown peg shape", key="shape", got=self.shape, choices=("round", "square"))
        rules = {
            "clearance_mm": (0.0, 20.0),
            "diameter": (0.005, 0.04),
            "depth": (0.005, 0.04),
            "chamfer": (-1e-9, 0.01),
            "friction": (-1e-9, 3.0),
            "block": (0.0, 0.2),
            "mesh_scale": (0.0, 1000.0),
            "mesh_concavity": (0.0099, 1.0),
            "peg_density": (10.0, 25000.0),
        }
        for key, (low, high) in rules.items():
            value = getattr(self, key)
            if not low < value <= high:
                raise UserError("impossible geometry", key=key, expected=f"{max(low, 0):g} to {high:g}", got=value)
        if not round(self.diameter * 1e3, 6).is_integer():
            raise UserError("a peg's diameter is whole millimetres", key="diameter", got=self.diameter)
        if self.apothem + self.chamfer >= self.block:
            raise UserError(
                "the hole is wider than its fixture", key="block", expected=f"> {self.apothem:g}", got=self.block
            )
        if len(self.solref) != 2 or not min(self.solref) > 0:
            expected = "a time constant (s) and a damping ratio, both above 0"
            raise UserError("impossible contact", key="solref", expected=expected, got=self.solref)
        for key, lengths in (("fixture", (3,)), ("hole_origin", (0, 3))):
            if len(getattr(self, key)) not in lengths:
                raise UserError("not a point", key=key, expected="x, y, z", got=getattr(self, key))
        x, y, z = self.fixture
        below = self.depth if self.hole_mesh else self.depth + hole.FLOOR
        if not (0.35 <= math.hypot(x, y) <= 0.75 and below - 1e-9 <= z <= 0.4):
            raise UserError(
                "the hole is out of reach",
                key="fixture",
                expected=f"0.35 to 0.75 m from the base's axis, {below:g} to 0.4 m high",
                got=self.fixture,
            )

    @property
    def apothem(self) -> float:
        """Distance of the hole's walls from its axis, m."""
        return self.diameter / 2 + self.clearance_mm / 2000


@dataclass(frozen=True, eq=False)
class Scene(RobotModel):
    """A robot in its cell: everything a RobotModel is, and what stands around it.

    Attributes:
        config: what it was built from.
        nominal: the arm with its tool and peg alone: what a controller knows.
        parts: geom names of each part that can be seen.
        lights, cameras: names.
        tip: height of the tip below the flange, m.
        target: nominal place of the goal, base frame, m.
        goal, tip_site: names of the sites that the task brings together, z of both along the way in.
        held, fixture: bodies of what the gripper holds and of what the goal is part of.
        slip: slide joint of the held part in the gripper; "" where it cannot slip.
    """

    config: SceneConfig = field(default_factory=SceneConfig)
    nominal: RobotModel = field(default=None)  # type: ignore[assignment]
    parts: dict[str, tuple[str, ...]] = field(default_factory=dict)
    lights: tuple[str, ...] = tuple(LIGHTS)
    cameras: tuple[str, ...] = CAMERAS
    tip: float = tools.GRASP + tools.PEG_LENGTH
    target: tuple[float, float, float] = SceneConfig.fixture
    goal: str = "hole"
    tip_site: str = "peg_tip"
    held: str = "peg"
    fixture: str = "fixture"
    slip: str = "peg_slip"


def build(config: SceneConfig | None = None, cameras: tuple[str, ...] = CAMERAS) -> Scene:
    """The cell for a configuration; equal configurations give the same object.

    Args:
        config: its geometry; the default cell if not given.
        cameras: names of those that stand in it, which effects of cameras find as their places.

    Raises:
        UserError: geometry that cannot be, mesh files that cannot be used.
    """
    config = config or SceneConfig()
    return _build(config, cameras, *user_cell.shapes(config))


@lru_cache(maxsize=32)
def _build(config: SceneConfig, cameras: tuple[str, ...], peg: UserShape | None, block: UserShape | None) -> Scene:
    config = user_cell.placed(config, block)
    arm = load("iiwa14", f"meg50+peg{round(config.diameter * 1000)}")
    tip = tools.GRASP + tools.PEG_LENGTH
    if peg is not None:
        arm, tip = user_cell.hold(peg, config.peg_density)
    spec = arm.spec()
    _options(spec)
    for part, colour in COLOURS.items():
        _material(spec, part, colour)
    parts = {"arm": tuple(g.name for g in spec.geoms if g.type == G.mjGEOM_MESH and not g.name.startswith("peg"))}
    parts |= _hand(spec, config)
    parts |= _fixture(spec, config, block)
    if peg is not None or block is not None:
        user_cell.check(spec, config, tip, peg, block)
    parts |= _room(spec)
    _lights(spec)
    _sensors(spec)
    base = {f.name: getattr(arm, f.name) for f in fields(RobotModel)}
    # a square peg is declared with its round sister's mass and inertia
    own = {"config": config, "nominal": arm, "parts": parts, "cameras": cameras, "tip": tip, "target": config.fixture}
    return Scene(**{**base, "build": spec.copy}, **own)


def _options(spec: mujoco.MjSpec) -> None:
    option = spec.option
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.impratio = 10.0
    spec.visual.headlight.ambient = (0.35, 0.35, 0.35)
    spec.visual.headlight.diffuse = (0.25, 0.25, 0.25)
    spec.visual.headlight.specular = (0.0, 0.0, 0.0)
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 20.0
    spec.visual.quality.offsamples = 0
    spec.visual.quality.shadowsize = 512
    spec.stat.extent = 1.0
    spec.stat.center = (0.5, 0.0, 0.2)


def _material(spec: mujoco.MjSpec, part: str, colour: tuple[float, float, float]) -> None:
    texture = spec.add_texture(
        name=part, type=mujoco.mjtTexture.mjTEXTURE_2D, width=TEXTURE, height=TEXTURE, nchannel=3
    )
    texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
    texture.rgb1 = texture.rgb2 = (1, 1, 1)
    material = spec.add_material(name=part, rgba=(*colour, 1.0), specular=0.2, shininess=0.3, texrepeat=(4, 4))
    material.texuniform = True
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = part


def _hand(spec: mujoco.MjSpec, config: SceneConfig) -> dict[str, tuple[str, ...]]:
    """Colours gripper and peg, gives the peg its contact and the joint along which it can slip."""
    gripper = ("gripper", "finger_left", "finger_right")
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
    slip.solref_friction, slip.solimp_friction = (0.002, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)  # no creep below it
    return {"gripper": gripper, "peg": ("peg",)}


def _fixture(spec: mujoco.MjSpec, config: SceneConfig, block: UserShape | None) -> dict[str, tuple[str, ...]]:
    seen = {"contype": 0, "conaffinity": 0, "material": "fixture"}
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
    body.add_geom(name="fixture", type=G.mjGEOM_MESH, meshname="fixture", **seen)
    return {"fixture": ("fixture",)}


def _room(spec: mujoco.MjSpec) -> dict[str, tuple[str, ...]]:
    world = spec.worldbody
    world.add_geom(
        name="table", type=G.mjGEOM_BOX, size=(0.6, 0.7, 0.02), pos=(0.45, 0, -0.02), material="table", **CONTACT
    )
    flat = {"contype": 0, "conaffinity": 0}
    world.add_geom(name="floor", type=G.mjGEOM_PLANE, size=(4, 4, 0.1), pos=(0, 0, -0.75), material="floor", **flat)
    world.add_geom(name="wall", type=G.mjGEOM_BOX, size=(0.02, 3, 2), pos=(1.6, 0, 1.0), material="wall", **flat)
    for i, shape in enumerate(SHAPES):
        world.add_geom(
            name=f"distractor{i}",
            type=shape,
            size=(0.001, 0.001, 0.001),
            pos=(0.9, 0.1 * i - 0.2, 0.0),
            rgba=(0.5, 0.5, 0.5, 0.0),
            material="distractors",
            **flat,
        )
    names = tuple(f"distractor{i}" for i in range(len(SHAPES)))
    return {"table": ("table",), "floor": ("floor",), "wall": ("wall",), "distractors": names}


def _sensors(spec: mujoco.MjSpec) -> None:
    """Wrench between flange and tool in the flange frame (N, N m), and the net contact force of the tool, peg included,
    on what it touches (world, N).
    """
    spec.body("tool").add_site(name="wrench", group=4)
    for name, kind in (("force", mujoco.mjtSensor.mjSENS_FORCE), ("torque", mujoco.mjtSensor.mjSENS_TORQUE)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="wrench")
    found, force, net = 1, 2, 3  # bits of what is reported; mjtConDataField and the reduction of the net force
    spec.add_sensor(
        name="contact",
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,
        objname="tool",
        intprm=[found | force, net, 1],
    )


def _lights(spec: mujoco.MjSpec) -> None:
    for i, (name, (pos, direction)) in enumerate(LIGHTS.items()):
        light = spec.worldbody.add_light(name=name, pos=pos, dir=direction)
        light.castshadow = False
        light.active = i < 2
        light.diffuse, light.ambient, light.specular = (0.5, 0.5, 0.5), (0, 0, 0), (0.2, 0.2, 0.2)
    sky = spec.add_texture(name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=384, nchannel=3)
    sky.builtin = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    sky.rgb1, sky.rgb2 = (0.75, 0.82, 0.9), (0.35, 0.38, 0.42)
