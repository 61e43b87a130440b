"""How the arm stands when an episode begins: the flange straight down, from a posture to work from."""

from __future__ import annotations

import numpy as np

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


__all__ = ["ABOVE", "DOWN", "home"]
