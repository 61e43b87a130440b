"""How an episode went: success by depth, lateral error, force and dwell, and a failure's category by a fixed rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.task import guards
from vispeg.task.environments.track import Track
from vispeg.task.peg.config import PegConfig

ENDS = ("success", "approach", "search", "jam", "wedge", "slip", "force limit", "timeout", "diverged")
CATEGORIES = (*ENDS, *guards.CATEGORIES)
ENTERED = 0.002  # m, depth from which the tip counts as in the hole
SLIPPED = 0.003  # m, slip along the peg that counts as lost
MOVING = 0.0005  # m a policy step, progress that counts as still going in


@dataclass
class PegTrack(Track):
    """What one row has seen so far in its episode.

    Attributes:
        deepest: greatest depth of the tip below the mouth while over the hole, m; beside the fixture is not in it.
        dwell: policy steps in a row at the goal: deep, close to the axis and gentle.
        tilt: angle between peg and hole, rad.
        slip: along the peg, m.
    """

    deepest: float = -1.0
    dwell: int = 0
    tilt: float = 0.0
    slip: float = 0.0

    def add(self, config: PegConfig, forces: np.ndarray, tip: np.ndarray, **observed: float) -> None:
        """Add a policy step: contact forces at its ticks, N; tip in the hole's frame (3,) m; `tilt` rad, `slip` m."""
        super().add(config, forces, tip)
        depth, self.tilt, self.slip = self.depths[-1], observed.get("tilt", 0.0), observed.get("slip", 0.0)
        over = self.lateral <= 0.5 * config.diameter
        close = self.lateral <= (config.success_lateral or 0.5 * config.diameter)
        gentle = forces.max() <= (config.success_force or config.force_abort)
        there = close and gentle and depth >= config.success_depth * config.depth
        self.dwell = self.dwell + 1 if there else 0
        self.deepest = max(self.deepest, depth if over else -1.0)

    def verdict(self, config: PegConfig) -> str | None:
        """Give the category once the episode is over by itself (success, force limit, slip), else None."""
        if self.peak > config.force_abort:
            return "force limit"
        if abs(self.slip) > SLIPPED:
            return "slip"
        return "success" if self.dwell >= config.dwell else None

    def at_time(self, config: PegConfig) -> str:
        """Give the category of an episode that ran out of time.

        `wedge` and `jam` follow Whitney (J. Dyn. Sys. Meas. Control 104, 1982): a peg is wedged when it stands across
        the hole at two points, which takes a tilt of clearance over depth; stuck below that tilt it is jammed by the
        direction of its forces. A peg that was still going in is neither, nor one that got to its depth and lacked only
        what else success takes.
        """
        if self.deepest >= config.success_depth * config.depth:
            return "timeout"
        if self.deepest > ENTERED:
            recent = self.depths[-4:]
            if len(recent) > 1 and (recent[-1] - recent[0]) / (len(recent) - 1) > MOVING:
                return "timeout"
            touching = config.clearance_mm * 1e-3 / max(self.deepest, 1e-6)
            return "wedge" if self.tilt >= 0.9 * touching else "jam"
        return "search" if self.touched else "approach"
