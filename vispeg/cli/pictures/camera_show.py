"""`vispeg camera show`: what is in a camera file, and what it means."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Show:
    """Shows the cameras of a file: the project's YAML, OpenCV's, or ROS's camera_info.

    Example:
        vispeg camera show wrist/camera.yaml
    """

    file: tyro.conf.Positional[Path]
    """Camera file."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print a row a camera."""
        from vispeg.api.cameras import show_cameras

        result = show_cameras(self.file)
        self.output.give(result.record, result.summary)
        return 0
