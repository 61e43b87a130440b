"""The standard cameras of a task: two on the flange, one beside the cell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.render.cameras.camera import Camera, looking_at

SIZE = 64  # px, both sides
MOUNT = (0.0, -0.10, 0.04)  # m, in the flange frame: beside the housing, where the fingers do not block the view
WIDE_FOV, EXTERNAL_FOV = 75.0, 36.0  # deg, whole angle
CROP_SCALE = 0.45e-3  # m per pixel at the held part's tip
EXTERNAL = (0.14, -0.42, 0.26)  # m, position relative to the goal, base axes
TIP, GOAL = 0.185, (0.6, 0.0, 0.05)  # m: the held part's tip below the flange, the goal in the base frame


def standard_cameras(tip: float = TIP, goal: Sequence[float] = GOAL) -> tuple[Camera, Camera, Camera]:
    """Return the cameras `wrist_wide`, `wrist_crop` and `external`, 64 x 64 px each.

    Args:
        tip: distance of the held part's tip from the flange along the flange's z axis, m (a Scene's `tip`).
        goal: (3,) nominal position of the goal, base frame, m (a Scene's `target`).

    Returns:
        `wrist_wide` has a field of view of 75 degrees and looks at the tip. `wrist_crop` has the same optical centre
        and shows the tip at 0.45 mm per pixel. `external` looks at the goal from the side.
    """
    target, up = np.array([0.0, 0.0, tip]), np.array([0.0, 0.0, -1.0])
    quat = looking_at(np.array(MOUNT), target, up)
    wide = square("wrist_wide", focal_of(WIDE_FOV)).moved(parent="flange", pos=MOUNT, quat=quat)
    distance = float(np.linalg.norm(target - MOUNT))
    crop = wide.moved(name="wrist_crop", fx=distance / CROP_SCALE, fy=distance / CROP_SCALE)
    pos = np.add(goal, EXTERNAL)
    view_quat = looking_at(pos, np.asarray(goal, float), np.array([0.0, 0.0, 1.0]))
    external = square("external", focal_of(EXTERNAL_FOV)).moved(pos=tuple(pos.tolist()), quat=view_quat)
    return wide, crop, external


def square(name: str, focal: float) -> Camera:
    """Return a camera of SIZE x SIZE px with its principal point in the middle, at the origin of the base."""
    middle = (SIZE - 1) / 2
    return Camera(name, SIZE, SIZE, focal, focal, middle, middle)


def focal_of(fov: float, size: int = SIZE) -> float:
    """Return the focal length in px at which `size` px span a field of view of `fov` degrees."""
    return float(size / 2 / np.tan(np.radians(fov) / 2))
