"""The peg-in-hole task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from vispeg.recordings.cell import Outcome
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import CAMERAS, Scene, build
from vispeg.task.contract import Task
from vispeg.task.environments.env import TaskEnv
from vispeg.task.environments.vector import TaskVec
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.expert import Expert
from vispeg.task.peg.outcome import CATEGORIES, PegTrack
from vispeg.task.peg.places import check_places
from vispeg.task.peg.terms import TERMS
from vispeg.task.terms import Simulation
from vispeg.worlds.randomized import RandomizedEffect
from vispeg.worlds.world import World


class PegTask(Task):
    """A peg, a hole, an arm under operational space control."""

    label = "peg"
    title = "Insert the peg into the hole."
    Config = PegConfig
    terms = TERMS
    categories = CATEGORIES
    hard_positions = Path(__file__).parent / "hard_positions.yaml"

    def cell(self, config: PegConfig, cameras: tuple[str, ...] | None = None) -> Scene:
        """Build the peg cell; see Task."""
        return build(config.scene(), CAMERAS if cameras is None else cameras)

    def check(self, scene: Scene, ranges: Sequence[tuple[RandomizedEffect, Path, str]], file: Path) -> None:
        """Check that the arm can reach the hole wherever the world may put it."""
        check_places(scene, None, file, "task.fixture")
        for r, where, key in ranges:
            if r.effect == "hole_offset":
                check_places(scene, r, where, key)

    def goal(self, config: PegConfig) -> np.ndarray:
        """Return the point on the hole's axis at the depth of success, (3,) m in the hole's frame."""
        return np.array([0.0, 0.0, -config.success_depth * config.depth])

    def within(self, config: PegConfig) -> float:
        """Return `PegConfig.within`."""
        return config.within

    def track(self) -> PegTrack:
        """Return a new PegTrack."""
        return PegTrack()

    def observed(self, sim: Simulation) -> Mapping[str, np.ndarray]:
        """Return `tilt` (n,) rad and `slip` (n,) m."""
        return {"tilt": sim.tilt(), "slip": sim.slip()}

    def again(self, rec: Recording, world: World, nthread: int = 1) -> tuple[np.ndarray, np.ndarray, Outcome]:
        """Simulate a recorded episode again, see Task.

        It succeeds if the tip reaches the depth of success with no more force than `force_abort`.
        """
        # imported here: these modules look up tasks
        from vispeg.task.belief import recorded_cell
        from vispeg.task.rig.record import outcome_of
        from vispeg.task.rig.replay import replay

        (ran,) = replay(rec, [world], nthread=nthread)
        ended = Outcome(False, 0, "diverged") if ran.diverged[0] else outcome_of(recorded_cell(rec), ran)[0]
        return ran.q[0], ran.ft[0], ended

    def expert(self, config: PegConfig, nsim: int) -> Expert:
        """Return the expert that hovers, lowers, searches in a spiral and pushes down."""
        return Expert(config, nsim)


class PegInHoleVec(TaskVec):
    """`num_envs` peg-in-hole environments, stepped together; see TaskVec."""


class PegInHoleEnv(TaskEnv):
    """One peg-in-hole environment; see TaskEnv."""
