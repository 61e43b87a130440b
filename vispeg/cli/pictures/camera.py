"""Calibrates a camera, or finds its place; shows camera files.

Example:
    vispeg camera calibrate images --pattern 9x6 --square 0.0236 --poses images/poses.csv --out wrist
    vispeg camera place tags.csv --robot iiwa14 --out wrist
    vispeg camera show wrist/camera.yaml
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from vispeg.cli.options import subcommand
from vispeg.cli.pictures.camera_calibrate import Calibrate
from vispeg.cli.pictures.camera_place import Place
from vispeg.cli.pictures.camera_show import Show


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg camera`."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Calibrate, subcommand(Calibrate)]
        | Annotated[Place, subcommand(Place)]
        | Annotated[Show, subcommand(Show)]
    ]

    def run(self) -> int:
        """Run the sub-command."""
        return self.command.run()
