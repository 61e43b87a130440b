"""Lists the effects that a model can have; with a name, explains one, and with --out draws what it does.

The picture shows what the effect, at its typical size, changes in one joint under position control, or in the pictures
of the cell's cameras.

Example:
    vispeg effects
    vispeg effects stribeck_friction
    vispeg effects stribeck_friction --where joint2 --out pictures
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro

from vispeg.cli.output import Output, OutputOptions

if TYPE_CHECKING:
    from vispeg.core.effect import Effect


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg effects`."""

    name: tyro.conf.Positional[str | None] = None
    """The effect to explain; all are listed where not given."""
    where: str | None = None
    """Where the picture puts the effect (a joint, a link, flange, base, all)."""
    robot: str = "iiwa14"
    """A robot's name or a path to an MJCF or URDF, whose joints and links are the places."""
    out: Path | None = None
    """Folder for the picture, effect-NAME.png; without it none is drawn."""
    overwrite: bool = False
    """Draw the picture anew if it is there."""
    family: Literal["joint", "drive", "sensor", "body", "contact", "task", "camera", "appearance"] | None = None
    """Only those of one family."""
    search: str | None = None
    """Only those with this text in their name, description or parameters."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Prints the list, or one effect's words, equation and parameters; draws its picture where asked to."""
        from vispeg import effects
        from vispeg.core.effect import effect, searchable
        from vispeg.report.text.catalogue import describe, print_catalogue, print_effect
        from vispeg.robots.model import load
        from vispeg.robots.scene import build
        from vispeg.worlds.words import place

        chosen = [effect(self.name)] if self.name else effects.find(self.search or "", self.family)
        arm, scene, arms = load(self.robot), build(), searchable()
        models = [arm if kind.name in arms else scene for kind in chosen]
        self._check()
        if self.where is not None:
            place(chosen[0], self.where, models[0])
        if self.output.json:
            entries = [describe(kind, m) for kind, m in zip(chosen, models, strict=True)]
            self.output.give({"effects": entries}, [])
        elif self.name is None:
            print_catalogue(chosen, models)
        else:
            print_effect(chosen[0], models[0])
            if self.out is not None:
                print(self._picture(chosen[0], scene, self.out / f"effect-{self.name}.png"))
        return 0

    def _check(self) -> None:
        """Raises UserError for arguments that would do nothing."""
        from vispeg.core.errors import UserError

        for flag, value in (("--family", self.family), ("--search", self.search)):
            if value is not None and self.name is not None:
                raise UserError("is about a list of effects", key=flag, expected="no NAME beside it")
        for flag, value in (("--where", self.where), ("--out", self.out)):
            if value is not None and (self.name is None or self.output.json):
                raise UserError("is about the picture of one effect", key=flag, expected="NAME, and no --json")
        if self.where is not None and self.out is None:
            raise UserError("says where the picture puts the effect", key="--where", expected="--out FOLDER beside it")

    def _picture(self, kind: Effect, scene: Any, path: Path) -> str:
        """Draws what the effect does; says where the picture lies, or why there is none."""
        from vispeg.core.effect import OPTICAL, searchable

        if path.exists() and not self.overwrite:
            return f"picture: {path} (from before; --overwrite draws it anew)"
        if kind.family in OPTICAL:
            from vispeg.report.drawings.look import draw

            draw(kind, self.where, scene, path, overwrite=self.overwrite)
            return f"picture: {path}"
        if kind.name not in searchable():
            return "no picture: its signature needs the task's cell"
        from vispeg.identify.signature import signature
        from vispeg.report.drawings.signature import signature_panels

        s = signature(kind.name, self.where, robot=self.robot)
        sizes = ", ".join(f"{k} {v.value:g} {kind.params[k].unit}" for k, v in s.placed.params.items())
        panels = [
            ("rad", {f"angle of {s.joint}, with less without": s.deviation}),
            ("N m", {f"motor torque of {s.joint}, with less without": s.torque}),
        ]
        over = {f"angle of {s.joint} (rad)": s.angle, f"speed of {s.joint} (rad/s)": s.speed}
        signature_panels(f"{s.placed.label}\n{sizes}", s.time, panels, path, against=over, overwrite=self.overwrite)
        return f"picture: {path}"
