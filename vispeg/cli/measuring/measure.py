"""Measures actuators and objects, with their uncertainty.

Every protocol writes a file `vispeg-measurement/1`: value, standard uncertainty, 95 % interval, uncertainty budget by
source, and the effect for a model. `vispeg add MODEL FILE` and a world's `model: FILE` take that file.

Example:
    vispeg measure plan joint4 --robot iiwa14 --out plan
    vispeg measure joint runs/* --joint joint4 --out joint4
    vispeg measure friction slides.csv --resolution angle_deg=0.1 --out friction.yaml
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from vispeg.cli.measuring.measure_joint import Joint, Plan
from vispeg.cli.measuring.measure_object import Com, Friction, Mass, Restitution, Stiffness
from vispeg.cli.measuring.measure_zeros import Zeros
from vispeg.cli.options import subcommand


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg measure`."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Plan, subcommand(Plan)]
        | Annotated[Joint, subcommand(Joint)]
        | Annotated[Zeros, subcommand(Zeros)]
        | Annotated[Mass, subcommand(Mass)]
        | Annotated[Com, subcommand(Com)]
        | Annotated[Friction, subcommand(Friction)]
        | Annotated[Restitution, subcommand(Restitution)]
        | Annotated[Stiffness, subcommand(Stiffness)]
    ]

    def run(self) -> int:
        """Run the sub-command."""
        return self.command.run()
