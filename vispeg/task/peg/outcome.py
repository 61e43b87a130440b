"""Classify an episode of the peg task: success by depth, lateral error, force and dwell; failures by fixed rules."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.task import guards
from vispeg.task.environments.track import Track
from vispeg.task.peg.config import PegConfig

ENDS = ("success", "approach", "search", "jam", "wedge", "slip", "force limit", "timeout", "diverged")
CATEGORIES = (*ENDS, *guards.CATEGORIES)
ENTERED = 0.002  # m, depth beyond which the tip counts as in the hole
SLIPPED = 0.003  # m, slip along the peg beyond which the grip counts as lost
MOVING = 0.0005  # m per policy step, progress beyond which the peg counts as still going in


@dataclass
class PegTrack(Track):
    """The course of one episode of the peg task.

    Attributes:
        deepest: greatest depth of the tip below the hole's mouth, m, counted only within half a peg's diameter of the
            hole's axis, so that a tip beside the fixture does not count; -1 if never there.
        dwell: number of consecutive policy steps, up to now, that met the conditions of success.
        tilt: present angle between peg and hole, rad.
        slip: present slip along the peg, m.
    """

    deepest: float = -1.0
    dwell: int = 0
    tilt: float = 0.0
    slip: float = 0.0

    def add(self, config: PegConfig, forces: np.ndarray, tip: np.ndarray, **observed: float) -> None:
        """Record one policy step.

        Args:
            config: the task's settings.
            forces: (ticks,) contact forces at its control ticks, N.
            tip: (3,) m in the hole's frame.
            observed: `tilt`, rad, and `slip`, m.
        """
        super().add(config, forces, tip)
        depth, self.tilt, self.slip = self.depths[-1], observed.get("tilt", 0.0), observed.get("slip", 0.0)
        over = self.lateral <= 0.5 * config.diameter
        close = self.lateral <= config.within
        gentle = forces.max() <= (config.success_force or config.force_abort)
        met = close and gentle and depth >= config.success_depth * config.depth
        self.dwell = self.dwell + 1 if met else 0
        self.deepest = max(self.deepest, depth if over else -1.0)

    def verdict(self, config: PegConfig) -> str | None:
        """Return the category if the episode has ended by itself (success, force limit, slip), else None."""
        if self.peak > config.force_abort:
            return "force limit"
        if abs(self.slip) > SLIPPED:
            return "slip"
        return "success" if self.dwell >= config.dwell else None

    def at_time(self, config: PegConfig) -> str:
        """Return the category of an episode that ran out of time.

        `wedge` and `jam` follow Whitney (J. Dyn. Sys. Meas. Control 104, 1982). A peg is wedged if it touches the hole
        at two opposite points, for which its tilt must be clearance over depth. A peg that is stuck at less tilt is
        jammed by the direction of its forces. A peg that was still going in, or that reached the depth but missed
        another condition of success, ran out of time (`timeout`).
        """
        if self.deepest >= config.success_depth * config.depth:
            return "timeout"
        if self.deepest > ENTERED:
            recent = self.depths[-4:]
            if len(recent) > 1 and (recent[-1] - recent[0]) / (len(recent) - 1) > MOVING:
                return "timeout"
            touching_tilt = config.clearance_mm * 1e-3 / max(self.deepest, 1e-6)
            return "wedge" if self.tilt >= 0.9 * touching_tilt else "jam"
        return "search" if self.touched else "approach"
