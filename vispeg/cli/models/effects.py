"""Lists the effects that a model can have, or explains one.

`--out` draws a picture: what the effect, at its typical size, changes in one joint under position control, or in the
pictures of the cell's cameras.

Example:
    vispeg effects
    vispeg effects stribeck_friction
    vispeg effects stribeck_friction --where joint2 --out pictures
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg effects`."""

    name: tyro.conf.Positional[str | None] = None
    """The effect to explain; default: list all."""
    where: str | None = None
    """Place of the effect in the picture: a joint, a link, flange, base, all."""
    robot: str = "iiwa14"
    """A robot's name or a path to an MJCF or URDF; its joints and links are the places."""
    out: Path | None = None
    """Folder for the picture, effect-NAME.png; default: none."""
    overwrite: bool = False
    """Replace the picture if it exists."""
    family: Literal["joint", "drive", "sensor", "body", "contact", "task", "camera", "appearance"] | None = None
    """Only effects of this family."""
    search: str | None = None
    """Only effects with this text in name, description or parameters."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print the list, or one effect's words, equation and parameters; draw its picture where asked to."""
        from vispeg.api.library.catalogue import effects
        from vispeg.report.text.catalogue import describe, print_catalogue, print_effect

        self._check()
        chosen = effects(self.name, self.search or "", self.family, self.robot)
        if self.output.json:
            self.output.give({"effects": [describe(kind, model) for kind, model in chosen]}, [])
        elif self.name is None:
            print_catalogue([kind for kind, _ in chosen], [model for _, model in chosen])
        else:
            picture = self._picture(self.name)
            print_effect(*chosen[0])
            print(*picture, sep="\n", end="\n" * len(picture))
        return 0

    def _picture(self, name: str) -> list[str]:
        if self.out is None:
            return []
        from vispeg.api.library.effect_picture import draw_effect

        return [draw_effect(name, self.out, where=self.where, robot=self.robot, overwrite=self.overwrite).line]

    def _check(self) -> None:
        """Raise UserError for arguments that would do nothing."""
        from vispeg.core.errors import UserError

        for flag, value in (("--family", self.family), ("--search", self.search)):
            if value is not None and self.name is not None:
                raise UserError("is about a list of effects", key=flag, expected="no NAME beside it")
        for flag, value in (("--where", self.where), ("--out", self.out)):
            if value is not None and (self.name is None or self.output.json):
                raise UserError("is about the picture of one effect", key=flag, expected="NAME, and no --json")
        if self.where is not None and self.out is None:
            raise UserError("says where the picture puts the effect", key="--where", expected="--out FOLDER beside it")
