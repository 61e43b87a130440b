"""White balls at known places before a camera, and where their outlines' centres must show."""

import mujoco
import numpy as np

from vispeg.core.rotation import quaternion
from vispeg.render.cameras.camera import Camera

BALLS = np.array([[0.0, 0.0, 0.8], [0.22, 0.12, 0.9], [-0.2, 0.1, 1.0], [0.15, -0.14, 0.75], [-0.16, -0.12, 0.7]])
RADIUS = 0.04  # m
POS = np.array([0.3, -0.4, 1.1])
AXES = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
EYE = Camera(
    "eye", 320, 240, 300, 300, 159.5, 119.5, parent="base", pos=tuple(POS), quat=tuple(quaternion(AXES).tolist())
)


def model(extra: str = "") -> mujoco.MjModel:
    """The balls of `BALLS` (camera axes, m) as geoms, `EYE` seeing them."""
    places = BALLS @ AXES.T + POS
    geoms = "".join(f'<geom name="ball{i}" size="{RADIUS}" pos="{x} {y} {z}"/>' for i, (x, y, z) in enumerate(places))
    light = '<light type="directional" dir="0 0 -1"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{light}{geoms}{extra}</worldbody></mujoco>")


def outline(camera: Camera) -> np.ndarray:
    """(n, 2) px of the centres of the balls' outlines.

    The cone that touches a ball at (X, Y, Z) of radius r cuts the image in an ellipse with its centre at
    (X Z, Y Z) / (Z^2 - r^2).
    """
    z = BALLS[:, 2:]
    return BALLS[:, :2] * z / (z**2 - RADIUS**2) * (camera.fx, camera.fy) + (camera.cx, camera.cy)
