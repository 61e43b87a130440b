"""`vispeg camera place`: where a camera is, from a table of transforms."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Place:
    """Finds where a camera is from robot poses and a tag's poses in the camera (hand-eye calibration).

    A row a picture: the flange's pose on the base (flange_x .. flange_qz) or the joint angles (with --robot), and the
    tag's pose in the camera (tag_x .. tag_qz). Turns may be qw qx qy qz, rx ry rz or roll pitch yaw; units stand in the
    header, or the data decide. Writes OUT/results.json and, with --intrinsics, OUT/camera.yaml. Intervals are 95 %.

    Example:
        vispeg camera place tags.csv --robot iiwa14 --out wrist
    """

    table: tyro.conf.Positional[Path]
    """Table of poses (.csv, .csv.gz, .parquet)."""
    out: Path
    """Folder for the results."""
    robot: str | None = None
    """The robot whose joint angles the table has, instead of the flange's poses."""
    mount: Literal["flange", "base"] = "flange"
    """What the camera is fixed to; the tag rests, or is on the flange."""
    orientation: Literal["rotation_vector", "fixed_xyz", "moving_xyz"] | None = None
    """What three angles of a turn mean; default: what fits."""
    intrinsics: Path | None = None
    """The camera's intrinsics, for a camera file: a camera file, OpenCV's, ROS's or ViSP's."""
    name: str = "camera"
    """The camera's name in camera.yaml."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Fits, writes the folder, prints the place."""
        from vispeg.api.camera_place import place_camera
        from vispeg.core.files import reserved
        from vispeg.report.text.summary import Line

        with reserved(self.out, self.overwrite, holds="calibration", inputs=(self.table, self.intrinsics)):
            result = place_camera(
                self.table,
                robot=self.robot,
                mount=self.mount,
                orientation=self.orientation,
                intrinsics=self.intrinsics,
                name=self.name,
            )
            result.save(self.out, overwrite=self.overwrite)
        what = "results.json" if self.intrinsics is None else "camera.yaml, results.json"
        self.output.give(result.record, [*result.summary, Line(f"wrote {self.out}: {what}", path=True)])
        return 0
