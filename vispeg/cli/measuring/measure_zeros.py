"""`vispeg measure zeros`: joint zeros and frames from a tracker's or a calibration's table of static poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.measuring.measuring import Measuring


@dataclass(frozen=True, kw_only=True)
class Zeros(Measuring):
    """Measures joint zeros and the frames of base and tip, from poses at rest.

    A row a pose, no time: the joint angles as read (called as the joints, or q1, q2, ..), the tip's measured x y z, and
    if there is one its orientation: qw qx qy qz, rx ry rz, or roll pitch yaw. Units stand in the header (x_mm, q1_deg),
    or the data decide. A zero that no pose can tell from a frame is named, not invented.

    Example:
        vispeg measure zeros tracker.csv --robot iiwa14 --out zeros.yaml
    """

    table: tyro.conf.Positional[Path]
    """Table of poses (.csv, .csv.gz, .parquet)."""
    robot: str
    """A robot's name, or a path to its MJCF or URDF."""
    base: Literal["known", "unknown"] = "unknown"
    """Whether the poses are in the robot's base frame; else it is found."""
    tool: Literal["known", "unknown"] = "unknown"
    """Whether the poses are the flange's; else the tip's place on it is found."""
    orientation: Literal["rotation_vector", "fixed_xyz", "moving_xyz"] | None = None
    """What three angles mean: a rotation vector, or turns about fixed (URDF's rpy) or moving axes; default: what
    fits."""

    def run(self) -> int:
        """Measures, writes OUT, prints zeros, frames and what cannot be told."""
        from vispeg.api.measure.zeros import measure_zeros

        return self.tell(
            measure_zeros(
                self.table,
                self.out,
                self.robot,
                base=self.base,
                tool=self.tool,
                orientation=self.orientation,
                settings=self.settings(),
            )
        )
