"""The scene in a robot's own file: the arm and everything else that the file contains.

World frame, lights and colours are those of the file. The visible shapes form the scene's parts: ARM, which is the
arm with its tool; one for each other body, which is also a `thing`, a body whose pose is known only roughly; and one
for each shape of the world body, such as a table or a floor.
"""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache

import mujoco

from vispeg.robots.model import RobotModel
from vispeg.robots.scene import Scene, visible

ARM = "arm"  # name of the part that is the arm with its tool


@lru_cache(maxsize=32)
def bench(robot: RobotModel) -> Scene:
    """Return the scene of a robot's own file; calls with the same object `robot` return the same object.

    Args:
        robot: the robot with its tool. Cameras in its file are left out: the cameras of a recording replace them.
    """
    spec = robot.spec()
    for camera in list(spec.cameras):
        spec.delete(camera)
    spec.visual.quality.offsamples = 0  # no multisampling: a pixel then shows one geom, as a ray does
    for i, light in enumerate(spec.lights):
        light.name = light.name or f"light{i}"
    for i, geom in enumerate(spec.worldbody.geoms):
        geom.name = geom.name or f"ground{i}"
    drawn = (*visible(spec), *(g.name for g in spec.geoms if g.group < 3 and g.name and _of_world_or_tool(g)))
    model = spec.compile()
    parts: dict[str, tuple[str, ...]] = {ARM: ()}
    things: list[str] = []
    of_arm = _arm_bodies(model, robot)
    for name in dict.fromkeys(drawn):
        body = int(model.geom_bodyid[model.geom(name).id])
        part = ARM if body in of_arm else name if body == 0 else model.body(body).name
        if body and body not in of_arm and part not in things:
            things.append(part)
        parts[part] = (*parts.get(part, ()), name)
    base = {f.name: getattr(robot, f.name) for f in fields(RobotModel)}
    seen = {"parts": parts, "things": tuple(things), "lights": tuple(light.name for light in spec.lights)}
    return Scene(**{**base, "build": spec.copy}, nominal=robot, **seen)


def shows(scene: Scene) -> bool:
    """Return whether the scene has a visible part other than the arm."""
    return any(part != ARM for part in scene.parts)


def _of_world_or_tool(geom: mujoco.MjsGeom) -> bool:
    return geom.parent.name in ("world", "tool")


def _arm_bodies(model: mujoco.MjModel, robot: RobotModel) -> set[int]:
    """Return the ids of the bodies that count as the arm.

    These are the robot's base unless it is the world body, every body that a joint of the file moves, and the
    descendants of both.
    """
    base = model.body(robot.base).id
    out = {base} if base else set()
    for b in range(1, model.nbody):
        if int(model.body_weldid[b]) != 0 or int(model.body_parentid[b]) in out:
            out.add(b)
    return out
