"""The pieces of a round goal: a part inside bears on several at once, and together they are as stiff as one contact.

The goal is a ring of n wedges. A part of width w within walls at a distance a bears on some `n w / (2 pi (a + w))` of
them, each as stiff as a flat wall alone, so that walls would be as many times too stiff where a part wedges. On the
top, where it slides from one piece to the next, pieces stay as stiff as they are: what sinks in meets their sides.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from vispeg.contact.hand import RULES
from vispeg.contact.path import Path, tips
from vispeg.effects.common.parts import shapes
from vispeg.effects.contact.contact_stiffness import scaled
from vispeg.robots.scene import Scene

RIM = 1e-3  # m below the mouth, under which a tip that presses on the top may be read to be


class Pieces:
    """The goal's pieces in a batch of hands. They have no contact of their own but that of what is held.

    Args:
        batch: whose effects are written.
        model: its nominal model.
        scene: the hand.
    """

    def __init__(self, batch: Any, model: mujoco.MjModel, scene: Scene):
        held, width = shapes(model, scene.held)[:1], scene.config.diameter  # effects write all of its shapes alike
        self.ids = [g for g in range(model.ngeom) if model.geom_priority[g] == RULES]
        if not self.ids:
            return
        pieces = max(1.0, len(self.ids) * width / (2 * np.pi * (scene.config.apothem + width)))
        friction, *self.law = (batch.expand(f"geom_{name}") for name in ("friction", "solref", "solimp"))
        friction[:, self.ids] = friction[:, held]
        solref, solimp = (values[:, held].copy() for values in self.law)
        self.alone, self.together = (solref, solimp), scaled(solref, solimp, 1 / pieces)

    def inside(self, tip: bool) -> None:
        """Sets their contacts for a part whose tip is inside the goal, or not."""
        if self.ids:
            for values, new in zip(self.law, self.together if tip else self.alone, strict=True):
                values[:, self.ids] = new


def inside(path: Path, scene: Scene) -> np.ndarray:
    """(n,) bool: where a path has the tip of the scene's part within its goal, below the bevel of the mouth."""
    tip, config = tips(path, scene), scene.config
    return (tip[:, 2] < -max(config.chamfer, RIM)) & (np.hypot(tip[:, 0], tip[:, 1]) < config.apothem)


def stretches(flag: np.ndarray, window: slice) -> list[slice]:
    """The window cut where the flag (n,) changes."""
    cuts = np.flatnonzero(np.diff(flag[window].astype(int))) + window.start + 1
    return [slice(a, b) for a, b in zip([window.start, *cuts], [*cuts, window.stop], strict=True)]
