"""Show the cameras of a file, as `vispeg camera show` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import POSE, load_posed, to_record
from vispeg.report.text.summary import Block, Summarised
from vispeg.report.text.tables import Column, Sheet

HEADS = ("camera", "px", "fx fy", "cx cy", "field deg", "lens k1 k2 p1 p2 k3", "on", "at m", "looks along")


@dataclass(frozen=True)
class CameraTable(Summarised):
    """A table of cameras, one per row.

    Attributes:
        cameras: the cameras.
        posed: whether the file states the pose of each.
    """

    cameras: Sequence[Camera]
    posed: Sequence[bool]

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg camera show --json`, without poses that the file does not state."""
        records = [(to_record(camera), posed) for camera, posed in zip(self.cameras, self.posed, strict=True)]
        return {"cameras": [{k: v for k, v in r.items() if posed or k not in POSE} for r, posed in records]}

    @property
    def summary(self) -> list[Block]:
        """Size, intrinsics, field of view, lens, position and direction of each camera."""
        rows = [_row(camera, posed) for camera, posed in zip(self.cameras, self.posed, strict=True)]
        return [Sheet([Column(head) for head in HEADS], rows)]


def show_cameras(file: str | Path) -> CameraTable:
    """Read the cameras of a file: this project's YAML, OpenCV's, or ROS's camera_info.

    Raises:
        UserError: a file of another kind.

    Args:
        file: camera file.
    """
    cameras, posed = zip(*load_posed(Path(file)), strict=True)
    return CameraTable(cameras, posed)


def field_of(camera: Camera) -> tuple[float, float]:
    """Return the field of view across and down, degrees, lens included, in line with the principal point."""
    right, down = camera.width - 0.5, camera.height - 0.5
    u, v = np.clip(camera.cx, -0.5, right), np.clip(camera.cy, -0.5, down)
    ends = [[(-0.5, v), (right, v)], [(u, -0.5), (u, down)]]
    ideal = np.degrees(np.arctan(camera.ideal(np.array(ends))))  # (axis, end, 2)
    return float(ideal[0, 1, 0] - ideal[0, 0, 0]), float(ideal[1, 1, 1] - ideal[1, 0, 1])


def _row(camera: Camera, posed: bool) -> list[str]:
    field = field_of(camera)
    place = [
        camera.parent,
        " ".join(f"{value:+.4f}" for value in camera.pos),
        " ".join(f"{value:+.2f}" for value in camera.rotation[:, 2]),
    ]
    return [
        camera.name,
        f"{camera.width}x{camera.height}",
        f"{camera.fx:.1f} {camera.fy:.1f}",
        f"{camera.cx:.1f} {camera.cy:.1f}",
        f"{field[0]:.0f}x{field[1]:.0f}",
        " ".join(f"{value:.3g}" for value in camera.distortion) if any(camera.distortion) else "none",
        *(place if posed else ["not stated"] * len(place)),
    ]
