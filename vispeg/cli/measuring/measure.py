"""Measures actuators and objects: joint, mass, COM, friction, restitution, stiffness, each with its uncertainty.

Every protocol writes a file `vispeg-measurement/1`: the number, its standard uncertainty and 95 % interval, the budget
by source, and the effect that it becomes. `vispeg add MODEL FILE` and a world's `model: FILE` take that file.

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

SUBCOMMAND = tyro.conf.subcommand


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg measure`."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Plan, SUBCOMMAND("plan")]
        | Annotated[Joint, SUBCOMMAND("joint")]
        | Annotated[Mass, SUBCOMMAND("mass")]
        | Annotated[Com, SUBCOMMAND("com")]
        | Annotated[Friction, SUBCOMMAND("friction")]
        | Annotated[Restitution, SUBCOMMAND("restitution")]
        | Annotated[Stiffness, SUBCOMMAND("stiffness")]
    ]

    def run(self) -> int:
        """Runs the sub-command."""
        return self.command.run()
