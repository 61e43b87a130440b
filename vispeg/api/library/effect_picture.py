"""Draw what an effect does, as `vispeg effects NAME --out` does."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from vispeg.core.effect import OPTICAL, effect, searchable
from vispeg.core.paths import expanded
from vispeg.identify.signature import signature
from vispeg.report.drawings.look import draw as draw_look
from vispeg.report.drawings.signature import signature_panels
from vispeg.report.text.summary import Line, html
from vispeg.robots.model import load
from vispeg.robots.scene import build
from vispeg.worlds.words import place

ROBOT = "iiwa14"  # robot of the picture by default


@dataclass(frozen=True)
class EffectPicture:
    """A picture of what an effect of typical size changes.

    Attributes:
        path: path of the PNG; None if there is no picture.
        note: why there is none, or that it existed already.
    """

    path: Path | None
    note: str = ""

    @property
    def line(self) -> str:
        """The line that the command prints."""
        return f"picture: {self.path}{self.note}" if self.path is not None else f"no picture: {self.note}"

    def _repr_html_(self) -> str:
        return html([Line(self.line, path=True)])


def draw_effect(
    name: str, out: str | Path, *, where: str | None = None, robot: str = ROBOT, overwrite: bool = False
) -> EffectPicture:
    """Draw what an effect does: in one joint under position control, or in the pictures of the cell's cameras.

    Args:
        name: name of the effect.
        out: folder for the picture, effect-NAME.png; a place or robot other than the default is in the name, too.
        where: the effect's place; by default a typical one.
        robot: a robot's name, or a path to an MJCF or URDF.
        overwrite: replace an existing picture.

    Raises:
        UserError: no such effect or place.
    """
    kind, arm = effect(name), name in searchable()
    shown = ["effect", name, where or "", Path(robot).stem if arm and robot != ROBOT else ""]
    file = re.sub(r"[^\w.]+", "-", "-".join(filter(None, shown)))
    path = expanded(out) / f"{file}.png"
    scene = None if arm else build()  # the cell, where an arm alone does not show the effect
    if where is not None:
        place(kind, where, load(robot) if scene is None else scene)
    if path.exists() and not overwrite:
        return EffectPicture(path, " (exists; --overwrite draws it again)")
    if kind.family in OPTICAL:
        if not draw_look(kind, where, scene or build(), path, overwrite=overwrite):
            return EffectPicture(None, "at its typical size it changes nothing in a picture from outside or the wrist")
        return EffectPicture(path)
    if not arm:
        return EffectPicture(None, "this effect acts only in the task's cell, which is not simulated here")
    s = signature(name, where, robot=robot)
    sizes = ", ".join(f"{k} {v.value:g} {kind.params[k].unit}" for k, v in s.placed.params.items())
    panels = [
        ("rad", {f"angle of {s.joint}: with the effect minus without": s.deviation}),
        ("N m", {f"motor torque of {s.joint}: with the effect minus without": s.torque}),
    ]
    over = {f"angle of {s.joint} (rad)": s.angle, f"speed of {s.joint} (rad/s)": s.speed}
    signature_panels(f"{s.placed.label}\n{sizes}", s.time, panels, path, against=over, overwrite=overwrite)
    return EffectPicture(path)
