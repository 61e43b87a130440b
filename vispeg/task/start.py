"""How an episode begins: with the flange pointing straight down near the goal, or in the state of a recorded trial."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.interface.observer import DOWN
from vispeg.robots.scene import Scene
from vispeg.sim.home import home_of

ABOVE = 0.03  # m, height of the tip over the goal in the home posture


def home(scene: Scene) -> np.ndarray:
    """Return the joint angles (nj,) rad from which inverse kinematics starts.

    They are the robot's declared home, else a solution with the tip `ABOVE` the goal.

    Raises:
        UserError: the arm cannot hold its tool over the goal.
    """
    x, y, z = scene.target
    return home_of(scene.nominal, (x, y, z + ABOVE + scene.tip), tuple(DOWN.tolist()))


@dataclass(frozen=True, eq=False)
class Start:
    """The start of one episode, in place of what its seed draws. The seed decides every attribute that is None.

    Attributes:
        q: (nj,) joint angles, rad.
        goal: (3,) m, true position of the goal in the base.
        believed: (3,) m, position of the goal in the base that policies are told.
        effects: all effects of the episode's world, except the offset of the goal if `goal` is given.
        source: the file that states it, for errors.
    """

    q: np.ndarray | None = None
    goal: np.ndarray | None = None
    believed: np.ndarray | None = None
    effects: tuple[EffectInstance, ...] | None = None
    source: Path | None = None
