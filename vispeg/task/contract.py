"""The interface of a task, which environments, training, evaluation and datasets use.

A task of your own subclasses `Task` in a module outside this package. A world file names it (`task: {name:
"MODULE:CLASS"}`), and then works in every command that takes a world. See docs/tutorials/your-own-task.md.
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
    """A scripted policy for n rows (parallel episodes), with the observations of a `state` policy."""

    def reset(self, rows: np.ndarray) -> None:
        """Begin a new episode in these rows (indices or mask)."""
        ...

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return actions (n, len(config.dof)) within +-1 for observations whose arrays are (n, ...)."""
        ...


class Task(ABC):
    """One task. In all methods `config` is an instance of its `Config`.

    Attributes:
        label: one word without a dash; `vispeg train LABEL-MODALITY`.
        title: the task as an instruction in one sentence, as datasets state it.
        Config: class of its settings, whose `rewards` are its reward terms.
        terms: what is observed. The first one that is not for policies (`Term.to`) is the tip in the goal's frame (m),
            which policies with images learn to estimate.
        categories: the ways in which an episode may end. They include `success`, `force limit`, `diverged` and those
            of the arm's guards (vispeg.task.guards).
        hard_positions: a `vispeg-positions/1` file of positions that an evaluation tries one by one, or None.
        motions: the motions that `vispeg record` makes in its cell: name -> function that returns a commanded path.
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
        """Return the cell for these settings, with the cameras of these names (by default all standard ones)."""

    def check(self, scene: Scene, ranges: Sequence[tuple[RandomizedEffect, Path, str]], file: Path) -> None:
        """Check that every episode of a world can begin.

        Args:
            scene: the cell for the settings of the world's task.
            ranges: the world's randomized effects, each with the file and key that state it.
            file: the world's file.

        Raises:
            UserError: a range with values at which this task is impossible.
        """

    # Episodes -------------------------------------------------------------------------------------------------
    def start(self, config: Any, radius: float, rng: np.random.Generator) -> np.ndarray:
        """Draw where the tip begins, (3,) m from the nominal goal in the base's axes.

        By default x and y are within +-`radius`, and z is within `config.start_height`.
        """
        aside = rng.uniform(-radius, radius, 2)
        return np.array([*aside, rng.uniform(*config.start_height)])

    def command(self, sim: Simulation, action: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the controller's target for a policy step.

        By default an action is an offset from the arm's measured pose along the directions that the policy moves, and
        the other directions are held.

        Args:
            sim: the simulation in its present state.
            action: (n, 6) within +-1; 0 in directions that the policy does not move.

        Returns:
            Position (n, 3) m in the base of the point that actions move: the tool's tip if the policy turns the flange,
            else the flange itself. Orientation (n, 4) wxyz of the flange in the base.
        """
        return sim.seen.offset_by(action)

    @abstractmethod
    def goal(self, config: Any) -> np.ndarray:
        """Return the tip's position that rewards aim at, (3,) m in the goal's frame."""

    def within(self, config: Any) -> float | None:
        """Return the greatest distance of the tip from the goal's axis at which it counts as there, m.

        On a robot that does not report success itself, a trial succeeds only within it. By default None: at any
        distance.
        """
        return None

    @abstractmethod
    def track(self) -> Track:
        """Return a new Track, which classifies how one episode ends."""

    def observed(self, sim: Simulation) -> Mapping[str, np.ndarray]:
        """Return what `Track.add` takes besides forces and the tip: arrays (n,) by keyword; by default nothing."""
        return {}

    def again(self, rec: Recording, world: World, nthread: int = 1) -> tuple[np.ndarray, np.ndarray, Outcome] | None:
        """Simulate a recorded episode again with a world's arm, under the recorded controller.

        Args:
            rec: one episode, with its cell.
            world: effects to add to those that the recording's cell states.
            nthread: threads of the simulation.

        Returns:
            Joint angles (n, nj) rad, the wrench (n, 6) N and N m of the flange on the tool in the flange's axes, and
            the outcome. None for a task that does not implement this.

        Raises:
            UserError: a recording that cannot be run again.
        """
        return None

    @abstractmethod
    def expert(self, config: Any, nsim: int) -> Expert:
        """Return the scripted expert for `nsim` rows."""
