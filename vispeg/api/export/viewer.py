"""Show a model in MuJoCo's viewer, with the effects that MuJoCo has elements for, as `vispeg view --native` does."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vispeg.api.inputs import read_model
from vispeg.core.errors import UserError
from vispeg.report.text.summary import Block, Line
from vispeg.sim.export import compiled_with
from vispeg.task.belief import robot_of_world

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class NativeViewer:
    """A model to be shown by MuJoCo's viewer.

    Attributes:
        name: the model, as named by the user.
        model: the compiled model with its effects.
        left_out: labels of the effects that MuJoCo has no element for.
    """

    name: str
    model: mujoco.MjModel
    left_out: Sequence[str]

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg view --native --json`."""
        return {"model": self.name, "left_out": [*self.left_out]}

    @property
    def summary(self) -> list[Block]:
        """The model, and the effects that are left out."""
        lines = [f"{self.name} in MuJoCo's viewer"]
        lines += [f"not in it, MuJoCo has no element for it: {label}" for label in self.left_out]
        return [Line(text, path=True) for text in lines]

    def launch(self) -> None:
        """Open the window; return when it is closed."""
        import mujoco.viewer

        mujoco.viewer.launch(self.model)


def open_viewer(name: str) -> NativeViewer:
    """Compile a model for the viewer.

    Args:
        name: a model file, a robot's name, or a path to an MJCF or URDF.

    Raises:
        UserError: no such model, or no display.
    """
    world = read_model(name)
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        expected = "a desktop session; leave out --native to use the page in a browser"
        raise UserError("there is no display", key="--native", expected=expected)
    scene = robot_of_world(world)
    model, left_out = compiled_with(world, scene)
    return NativeViewer(name, model, [e.label for e in left_out])
