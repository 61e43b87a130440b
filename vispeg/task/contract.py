"""What a task is: the contract that environments, training, evaluation and datasets are written against.

A task of your own subclasses `Task` in a module outside this package; a world file names it (`task: {name:
"MODULE:CLASS"}`), and every command that takes a world takes it. See docs/tutorials/your-own-task.md.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from vispeg.robots.scene import Scene
from vispeg.task.config import TaskConfig
from vispeg.task.environments.track import Track
from vispeg.task.rig.motions import PATHS, Motions
from vispeg.task.terms import Simulation, Term

if TYPE_CHECKING:
    from vispeg.recordings.cell import Outcome
    from vispeg.recordings.recording import Recording
    from vispeg.worlds.randomized import RandomizedEffect
    from vispeg.worlds.world import World


class Expert(Protocol):
    """A scripted policy for n rows, which acts on what a `state` policy sees."""

    def reset(self, rows: np.ndarray) -> None:
        """Let these rows (indices or mask) begin a new episode."""
        ...

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """Observations (n, ...) -> actions (n, len(dof)) within +-1."""
        ...


class Task(ABC):
    """One task.

    Attributes:
        label: one word without a dash; `vispeg train LABEL-MODALITY`.
        title: what a person would ask for, in a sentence; the instruction in datasets.
        Config: its settings, whose `rewards` are its reward terms.
        terms: what is observed; the first of the ground truth is the tip in the goal's frame (m), which policies that
            see learn to estimate.
        categories: how an episode may end; `success`, `force limit` and `diverged` are among them, and those of the
            arm's guards (vispeg.task.guards).
        hard_positions: a `vispeg-positions/1` file of places that are tried one by one, or None.
        motions: name -> commanded path of the motions that `vispeg record` makes in its cell.
    """

    label: ClassVar[str]
    title: ClassVar[str]
    Config: ClassVar[type[TaskConfig]]
    terms: ClassVar[tuple[Term, ...]]
    categories: ClassVar[tuple[str, ...]]
    hard_positions: ClassVar[Path | None] = None
    motions: ClassVar[Motions] = PATHS

    # Cell -----------------------------------------------------------------------------------------------------
    @abstractmethod
    def cell(self, config: Any, cameras: tuple[str, ...] | None = None) -> Scene:
        """Give the cell that these settings ask for, with cameras of these names (by default all standard ones)."""

    def check(self, scene: Scene, ranges: Sequence[tuple[RandomizedEffect, Path, str]], file: Path) -> None:
        """Whether every episode of a world can be begun.

        Args:
            scene: the cell as the world's task has it.
            ranges: of the world, each with the file and key that state it.
            file: of the world.

        Raises:
            UserError: a range that this task cannot stand.
        """

    # Episodes -------------------------------------------------------------------------------------------------
    def start(self, config: Any, radius: float, rng: np.random.Generator) -> np.ndarray:
        """Where the tip begins, (3,) m from the nominal goal in the base's axes: aside by up to `radius`, above."""
        aside = rng.uniform(-radius, radius, 2)
        return np.array([*aside, rng.uniform(*config.start_height)])

    def command(self, sim: Simulation, action: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Give the controller's target of a policy step: the point that is held (n, 3) m, the flange's turn (n, 4)
        wxyz.

        An action is an offset from where the arm is, along the directions that the policy moves; the others are held.

        Args:
            sim: as it stands.
            action: (n, 6), 0 in directions that the policy does not move.
        """
        return sim.seen.offset_by(action)

    @abstractmethod
    def goal(self, config: Any) -> np.ndarray:
        """Where rewards want the tip, (3,) m in the goal's frame."""

    @abstractmethod
    def track(self) -> Track:
        """Give the judge of one episode."""

    def observed(self, sim: Simulation) -> Mapping[str, np.ndarray]:
        """Return what the judge observes besides forces and the tip: arrays (n,) by keyword of `Track.add`."""
        return {}

    def again(self, rec: Recording, world: World, nthread: int = 1) -> tuple[np.ndarray, np.ndarray, Outcome] | None:
        """Give a recorded episode run again by a world's arm under the controller that ran; None where a task has no
        way.

        Args:
            rec: one episode, with its cell.
            world: effects beside those that the recording believes in.
            nthread: of the simulation.

        Returns:
            Joint angles (n, nj) rad, the wrench (n, 6) N and N m that the flange puts on the tool in its own axes, and
            how it ended.

        Raises:
            UserError: a recording that cannot be run again.
        """
        return None

    @abstractmethod
    def expert(self, config: Any, nsim: int) -> Expert:
        """Give the scripted expert for n rows."""
