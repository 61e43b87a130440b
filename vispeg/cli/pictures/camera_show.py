"""`vispeg camera show`: what is in a camera file, and what it means."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Show:
    """Shows the cameras of a file: the project's YAML, OpenCV's, or ROS's camera_info.

    Example: vispeg camera show wrist/camera.yaml
    """

    file: tyro.conf.Positional[Path]
    """Camera file."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Prints a row a camera."""
        import numpy as np

        from vispeg.render.cameras.camera_files import load_cameras, to_record
        from vispeg.report.text.tables import Column, Sheet

        cameras = load_cameras(self.file)
        heads = ("camera", "px", "fx fy", "cx cy", "field deg", "lens k1 k2 p1 p2 k3", "on", "at m", "looks along")
        rows = []
        for camera in cameras:
            field = [
                2 * np.degrees(np.arctan(s / 2 / f)) for s, f in ((camera.width, camera.fx), (camera.height, camera.fy))
            ]
            rows.append(
                [
                    camera.name,
                    f"{camera.width}x{camera.height}",
                    f"{camera.fx:.1f} {camera.fy:.1f}",
                    f"{camera.cx:.1f} {camera.cy:.1f}",
                    f"{field[0]:.0f}x{field[1]:.0f}",
                    " ".join(f"{value:.3g}" for value in camera.distortion) if any(camera.distortion) else "none",
                    camera.parent,
                    " ".join(f"{value:+.4f}" for value in camera.pos),
                    " ".join(f"{value:+.2f}" for value in camera.rotation[:, 2]),
                ]
            )
        values = {"cameras": [to_record(camera) for camera in cameras]}
        self.output.give(values, [Sheet([Column(head) for head in heads], rows)])
        return 0
