"""A bench of one's own: the scene that a robot's own file shows, its arm and whatever else stands in it.

World frame: the file's. Every body beside the arm is a part, and a thing whose place nobody knows to a tenth of a
millimetre; shapes of the world itself (a table, a floor) are a part each. Lights and colours are the file's.
"""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache

import mujoco

from vispeg.robots.model import RobotModel
from vispeg.robots.scene import Scene, visible

ARM = "arm"  # the part that is the arm with its tool


@lru_cache(maxsize=32)
def bench(robot: RobotModel) -> Scene:
    """Give the scene of a robot's own file; the same robot gives the same scene.

    Args:
        robot: with its tool; its cameras are left out: those of a recording take their place.
    """
    spec = robot.spec()
    for camera in list(spec.cameras):
        spec.delete(camera)
    spec.visual.quality.offsamples = 0  # a pixel shows one thing, as a ray does
    for i, light in enumerate(spec.lights):
        light.name = light.name or f"light{i}"
    for i, body in enumerate(spec.bodies):
        body.name = body.name or f"body{i}"
    for i, geom in enumerate(spec.worldbody.geoms):
        geom.name = geom.name or f"ground{i}"
    drawn = (*visible(spec), *(g.name for g in spec.geoms if g.group < 3 and g.name and _beside(g)))
    model = spec.compile()
    parts: dict[str, tuple[str, ...]] = {ARM: ()}
    things: list[str] = []
    moved = _arm(model, robot)
    for name in dict.fromkeys(drawn):
        body = int(model.geom_bodyid[model.geom(name).id])
        part = ARM if body in moved else name if body == 0 else model.body(body).name
        if body and body not in moved and part not in things:
            things.append(part)
        parts[part] = (*parts.get(part, ()), name)
    base = {f.name: getattr(robot, f.name) for f in fields(RobotModel)}
    seen = {"parts": parts, "things": tuple(things), "lights": tuple(light.name for light in spec.lights)}
    return Scene(**{**base, "build": spec.copy}, nominal=robot, **seen)


def shows(scene: Scene) -> bool:
    """Whether there is more to see than the arm itself."""
    return any(part != ARM for part in scene.parts)


def _beside(geom: mujoco.MjsGeom) -> bool:
    return geom.parent.name in ("world", "tool")


def _arm(model: mujoco.MjModel, robot: RobotModel) -> set[int]:
    """Ids of the arm's bodies: its base with what is fixed to it, and all that its joints move."""
    base = model.body(robot.base).id
    out = {base} if base else set()
    for b in range(1, model.nbody):
        if int(model.body_weldid[b]) != 0 or int(model.body_parentid[b]) in out:
            out.add(b)
    return out
