"""Adds an effect or a measurement to a model file.

An effect that the model has gets the values of --set; its other parameters stay. A new effect without --set has its
typical size; with --set, its other parameters are null. MODEL is replaced only if --out names it, with --overwrite.

Example:
    vispeg add iiwa14 coulomb_friction joint4 --set torque=1.2 --out model.yaml
    vispeg add model.yaml payload flange --set mass=0.6 z=0.07 --out model2.yaml
    vispeg add model.yaml joint4/measurement.yaml --out model2.yaml
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True, kw_only=True)
class Args:
    """Arguments of `vispeg add`."""

    model: tyro.conf.Positional[str]
    """A model file, a robot's name, or a path to an MJCF or URDF."""
    effect: tyro.conf.Positional[str]
    """An effect's name (`vispeg effects` lists them), or a measurement file, whose effects are added."""
    where: tyro.conf.Positional[str | None] = None
    """Place: a joint, a link, `flange`, `base`, or `all`."""
    out: Path
    """The model file to write."""
    set: tuple[str, ...] = ()
    """Values, such as torque=1.2 velocity=0.05."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Write the model file and print what is in it."""
        from vispeg.api.add import add

        result = add(self.model, self.effect, self.out, where=self.where, settings=self.set, overwrite=self.overwrite)
        self.output.give(result.record, result.summary)
        return 0
