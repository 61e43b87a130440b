"""A picture of the robot in its cell, seen from the side, with where its joints and links are in it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vispeg.render.backends.backend import BackendName, Renderer
from vispeg.render.cameras.camera import Camera, looking_at
from vispeg.render.cameras.standard import focal_of
from vispeg.robots.scene import build
from vispeg.task.start import home

WIDTH, HEIGHT, FOV = 720, 540, 34.0  # px; degrees over the height
EYE, TARGET = (1.35, -1.5, 0.95), (0.3, 0.0, 0.4)  # m, base frame: before the wall, beside the table
COLOURS: Mapping[str, tuple[float, float, float]] = {
    "table": (0.62, 0.53, 0.43),
    "floor": (0.30, 0.32, 0.35),
    "wall": (0.80, 0.82, 0.84),
    "fixture": (0.20, 0.42, 0.66),
    "gripper": (0.25, 0.26, 0.28),
}
HELD = (0.85, 0.55, 0.15)


def draw(backend: BackendName = "auto") -> tuple[np.ndarray, dict[str, list[float]]]:
    """Give the picture, and where places of effects lie in it.

    Returns:
        (HEIGHT, WIDTH, 3) uint8; and for each joint, link and the flange its (x, y), each 0 to 1 from the top left.

    Raises:
        UserError: no renderer that works here.
    """
    focal, up = focal_of(FOV, HEIGHT), np.array([0.0, 0.0, 1.0])
    quat = looking_at(np.array(EYE), np.array(TARGET), up)
    camera = Camera("cell", WIDTH, HEIGHT, focal, focal, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, pos=EYE, quat=quat)
    scene = build()
    with Renderer(scene, [camera], backend, shadows=True) as renderer:
        model, data = renderer.model, renderer.data
        for name, colour in {**COLOURS, **dict.fromkeys(scene.parts[scene.held], HELD)}.items():
            model.geom(name).rgba[:3] = colour
        posture = home(scene)
        shot = renderer.render(np.concatenate([posture, np.zeros(model.nq - len(posture))]))["cell"]
        points = {name: data.joint(name).xanchor for name in scene.joints}
        points |= {name: data.body(name).xipos for name in scene.links}
        points["flange"] = data.site("flange").xpos
        places = {name: _pixel(np.asarray(p, float), camera) for name, p in points.items()}
    return shot.rgb, places


def _pixel(point: np.ndarray, camera: Camera) -> list[float]:
    """(x, y) of a point (3,) in m of the base frame, as shares of the picture's width and height."""
    x, y, z = camera.rotation.T @ (point - np.array(camera.pos))
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    return [round(float((u + 0.5) / camera.width), 4), round(float((v + 0.5) / camera.height), 4)]
