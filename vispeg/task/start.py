"""How an episode begins: the flange straight down, from a posture to work from; or as a trial began."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.interface.observer import DOWN
from vispeg.robots.scene import Scene
from vispeg.sim.home import home_of

ABOVE = 0.03  # m, height of the tip over the goal


def home(scene: Scene) -> np.ndarray:
    """Joint angles (nj,) rad from which inverse kinematics starts: the robot's declared home, or a solved one.

    Raises:
        UserError: the arm cannot hold its tool over the goal.
    """
    x, y, z = scene.target
    return home_of(scene.nominal, (x, y, z + ABOVE + scene.tip), tuple(DOWN.tolist()))


@dataclass(frozen=True, eq=False)
class Start:
    """How one episode begins, in place of what its seed draws; None leaves that to the seed.

    Attributes:
        q: (nj,) rad, how the arm stands.
        goal: (3,) m, where the goal really is, base.
        believed: (3,) m, where a policy is told that it is, base.
        effects: all that makes the episode's world differ from nominal, beside where the goal is.
    """

    q: np.ndarray | None = None
    goal: np.ndarray | None = None
    believed: np.ndarray | None = None
    effects: tuple[EffectInstance, ...] | None = None


__all__ = ["ABOVE", "DOWN", "Start", "home"]
