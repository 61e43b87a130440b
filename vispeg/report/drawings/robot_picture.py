"""Draw the robot in its cell from the side, and locate its joints and links in the picture."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vispeg.render.backends.backend import BackendName, Renderer
from vispeg.render.cameras.camera import Camera, looking_at
from vispeg.render.cameras.standard import focal_of
from vispeg.robots.scene import build
from vispeg.task.start import home

WIDTH, HEIGHT, FOV = 720, 540, 34.0  # px; vertical field of view, degrees
EYE, TARGET = (1.35, -1.5, 0.95), (0.3, 0.0, 0.4)  # m, base frame: in front of the wall, beside the table
COLOURS: Mapping[str, tuple[float, float, float]] = {
    "table": (0.62, 0.53, 0.43),
    "floor": (0.30, 0.32, 0.35),
    "wall": (0.80, 0.82, 0.84),
    "fixture": (0.20, 0.42, 0.66),
    "gripper": (0.25, 0.26, 0.28),
}
HELD = (0.85, 0.55, 0.15)


def draw(backend: BackendName = "auto") -> tuple[np.ndarray, dict[str, list[float]]]:
    """Return the picture, and the positions of joints, links and flange in it.

    Returns:
        The picture (HEIGHT, WIDTH, 3) uint8; and name -> [x, y], shares of width and height from the top left.

    Raises:
        UserError: no working renderer.
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
    """Project a point (3,), m, base frame; return [x, y] as shares of the picture's width and height."""
    x, y, z = camera.rotation.T @ (point - np.array(camera.pos))
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    return [round(float((u + 0.5) / camera.width), 4), round(float((v + 0.5) / camera.height), 4)]
