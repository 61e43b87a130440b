"""The surroundings of the arm (table, floor, wall, distractors, lights), materials, and the solver's options.

Each part has one material and one texture, which randomized looks change.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from vispeg.robots.user_shapes import UserThing, add_seen

TOUCHED, UNTOUCHED = 1, 2  # contypes; the parts of a cell collide only with the first

G = mujoco.mjtGeom
CONTACT = {"contype": TOUCHED, "conaffinity": 0}
BELOW = 2.0  # m below the table, where unused meshes are put: unlike a primitive shape, a mesh cannot be shrunk
TEXTURE = 128  # px, side of a part's texture
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
# position, m, and direction of each light; the first two are on
LIGHTS = {
    "key": ((0.2, -0.8, 1.6), (0.3, 0.6, -1.0)),
    "fill": ((0.4, 0.9, 1.5), (0.1, -0.6, -1.0)),
    "side": ((1.2, 0.2, 1.2), (-0.6, 0.0, -1.0)),
    "back": ((-0.5, 0.0, 1.8), (0.8, 0.0, -1.0)),
}


def options(spec: mujoco.MjSpec) -> None:
    """Set the solver's options and the visual settings of the cell."""
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


def material(spec: mujoco.MjSpec, part: str, colour: tuple[float, float, float]) -> None:
    """Add a part's material and texture."""
    texture = spec.add_texture(
        name=part, type=mujoco.mjtTexture.mjTEXTURE_2D, width=TEXTURE, height=TEXTURE, nchannel=3
    )
    texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
    texture.rgb1 = texture.rgb2 = (1, 1, 1)
    material = spec.add_material(name=part, rgba=(*colour, 1.0), specular=0.2, shininess=0.3, texrepeat=(4, 4))
    material.texuniform = True
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = part


def room(spec: mujoco.MjSpec, things: Sequence[UserThing] = ()) -> dict[str, tuple[str, ...]]:
    """Add table, floor, wall and distractors; return the geom names of each part.

    Args:
        spec: the spec of the cell.
        things: the user's distractors; if empty, the built-in shapes are used.
    """
    world = spec.worldbody
    world.add_geom(
        name="table", type=G.mjGEOM_BOX, size=(0.6, 0.7, 0.02), pos=(0.45, 0, -0.02), material="table", **CONTACT
    )
    untouched = {"contype": 0, "conaffinity": 0}
    world.add_geom(
        name="floor", type=G.mjGEOM_PLANE, size=(4, 4, 0.1), pos=(0, 0, -0.75), material="floor", **untouched
    )
    world.add_geom(name="wall", type=G.mjGEOM_BOX, size=(0.02, 3, 2), pos=(1.6, 0, 1.0), material="wall", **untouched)
    names = tuple(f"distractor{i}" for i in range(len(things or SHAPES)))
    parked = {"rgba": (0.5, 0.5, 0.5, 0.0), "material": "distractors"}
    for name, thing in zip(names, things, strict=False):
        add_seen(spec, world, name, thing.vertices, thing.faces, {"pos": (0.9, 0.0, -BELOW), **parked})
    built_in = () if things else SHAPES
    for i, (name, shape) in enumerate(zip(names, built_in, strict=False)):
        world.add_geom(
            name=name, type=shape, size=(0.001, 0.001, 0.001), pos=(0.9, 0.1 * i - 0.2, 0.0), **parked, **untouched
        )
    return {"table": ("table",), "floor": ("floor",), "wall": ("wall",), "distractors": names}


def lights(spec: mujoco.MjSpec) -> None:
    """Add the lights and the sky."""
    for i, (name, (pos, direction)) in enumerate(LIGHTS.items()):
        light = spec.worldbody.add_light(name=name, pos=pos, dir=direction)
        light.castshadow = False
        light.active = i < 2
        light.diffuse, light.ambient, light.specular = (0.5, 0.5, 0.5), (0, 0, 0), (0.2, 0.2, 0.2)
    sky = spec.add_texture(name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=384, nchannel=3)
    sky.builtin = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    sky.rgb1, sky.rgb2 = (0.75, 0.82, 0.9), (0.35, 0.38, 0.42)
