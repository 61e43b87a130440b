"""The base of the effects of the wrist's force sensor: their target, and the names of the six components."""

from __future__ import annotations

from typing import Any

import numpy as np

from vispeg.core.effect import Effect, Values
from vispeg.effects.common.parts import in_scene

FORCE, TORQUE = ("fx", "fy", "fz"), ("tx", "ty", "tz")


class WristEffect(Effect):
    """An effect of the force sensor between flange and tool."""

    family = "sensor"
    searchable = False

    def targets(self, model: Any) -> list[str]:
        """Return the flange of a Scene with a task; an arm alone carries no force sensor."""
        return in_scene(model, "flange")


def six(force: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Return (nsim, 6): three times the value (nsim, 1) for forces, then three times that for torques."""
    return np.concatenate([np.repeat(force, 3, axis=1), np.repeat(torque, 3, axis=1)], axis=1)


def axes(p: Values) -> np.ndarray:
    """Return the parameters `fx fy fz tx ty tz` side by side: (nsim, 6)."""
    return np.concatenate([p[axis] for axis in (*FORCE, *TORQUE)], axis=1)
