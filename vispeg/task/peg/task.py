"""The peg-in-hole task, first tenant of the contract."""

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
        """See Task."""
        return build(config.scene(), CAMERAS if cameras is None else cameras)

    def check(self, scene: Scene, ranges: Sequence[tuple[RandomizedEffect, Path, str]], file: Path) -> None:
        """Require that the arm can reach the hole wherever it may stand."""
        check_places(scene, None, file, "task.fixture")
        for r, where, key in ranges:
            if r.effect == "hole_offset":
                check_places(scene, r, where, key)

    def goal(self, config: PegConfig) -> np.ndarray:
        """On the axis, as deep as success asks."""
        return np.array([0.0, 0.0, -config.success_depth * config.depth])

    def track(self) -> PegTrack:
        """See Task."""
        return PegTrack()

    def observed(self, sim: Simulation) -> Mapping[str, np.ndarray]:
        """Tilt and slip."""
        return {"tilt": sim.tilt(), "slip": sim.slip()}

    def again(self, rec: Recording, world: World, nthread: int = 1) -> tuple[np.ndarray, np.ndarray, Outcome]:
        """Require that the tip comes as deep as success asks, with no more force than the task allows."""
        from vispeg.task.belief import recorded_cell
        from vispeg.task.rig.record import outcome_of  # which builds cells, and so looks up tasks
        from vispeg.task.rig.replay import replay

        (ran,) = replay(rec, [world], nthread=nthread)
        ended = Outcome(False, 0, "diverged") if ran.diverged[0] else outcome_of(recorded_cell(rec), ran)[0]
        return ran.q[0], ran.ft[0], ended

    def expert(self, config: PegConfig, nsim: int) -> Expert:
        """Hovers, lowers, searches in a spiral, pushes down."""
        return Expert(config, nsim)


class PegInHoleVec(TaskVec):
    """`num_envs` peg-in-hole environments, stepped together; see TaskVec."""


class PegInHoleEnv(TaskEnv):
    """One peg-in-hole environment; see TaskEnv."""
