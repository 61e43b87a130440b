"""Observation terms: named parts of an observation, each with unit, scale and recipient.

A task lists its terms (`Task.terms`); `Observation` concatenates them and finds each by its name. The policy's terms
are stacked, newest first (`TaskConfig.stack`); the ground truth is that of the current step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.interface.terms import POLICY, Sensed, scaled
from vispeg.task.config import TaskConfig

if TYPE_CHECKING:
    from vispeg.interface.observer import Observer
    from vispeg.robots.scene import Scene
    from vispeg.task.cell import Cell
    from vispeg.worlds.randomized import RandomizedWorld


class Simulation(Protocol):
    """The part of a simulation that tasks and terms may read: `nsim` independent episodes, one per row.

    `vispeg.task.environments.simulation.TaskSimulation` implements it.

    Attributes:
        nsim: number of rows.
        world: the effects from which episodes are drawn.
        config: settings of the task, of the task's own class.
        scene: the nominal cell.
        cell: the batch of simulated cells in its present state.
        seen: the robot's measurements and the commanded pose.
        nominal_goal: (3,) m, nominal position of the goal, base frame.
        seeds: (nsim,) seeds of the present episodes.
        count: (nsim,) policy steps since their begin.
    """

    nsim: int
    world: RandomizedWorld
    config: Any
    scene: Scene
    cell: Cell
    seen: Observer
    nominal_goal: np.ndarray
    seeds: np.ndarray
    count: np.ndarray

    def tip_in_goal(self) -> np.ndarray:
        """Return the true tip (nsim, 3) m in the goal's frame; z is negative below its plane."""
        ...

    def tilt(self) -> np.ndarray:
        """Return the angle (nsim,) rad between the tip's axis and the goal's."""
        ...

    def slip(self) -> np.ndarray:
        """Return how far (nsim,) m the held part slipped in the gripper; 0 where it cannot."""
        ...


@dataclass(frozen=True)
class Term:
    """One observation term.

    Attributes:
        name: unique in a task.
        read: function that returns (nsim, size) in `unit`, called with the measurements
            (`vispeg.interface.observer.Observer`) for a term of the policy, with the simulation for ground truth.
        size: length of the term, or a function of the task's settings.
        unit: unit of `read`.
        scale: in `unit`; an observation holds `read / scale`, near 1.
        to: who may see it: the `policy` (and teachers and critics), a `teacher` (and critics), or a `critic` alone.
        about: one line of description.
        noise: standard deviation, in `unit`, of added white noise, drawn from the episode's seed.
        when: returns whether a task with these settings has the term.
    """

    name: str
    read: Callable[[Any], np.ndarray]
    size: int | Callable[[TaskConfig], int]
    unit: str
    scale: float
    to: Literal["policy", "teacher", "critic"]
    about: str
    noise: float = 0.0
    when: Callable[[TaskConfig], bool] = lambda config: True

    @classmethod
    def sensed(cls, term: Sensed) -> Term:
        """Make the task's term of a sensed quantity that policies observe."""
        size = term.size or (lambda config: len(config.dof))
        when = (lambda config: config.turns) if term.turning else (lambda config: True)
        return cls(term.name, term.read, size, term.unit, term.scale, POLICY, term.about, when=when)

    def length(self, config: TaskConfig) -> int:
        """Return the term's length in a task with these settings."""
        return self.size if isinstance(self.size, int) else self.size(config)


class Observation:
    """The observation terms of a task with given settings, in order.

    Args:
        terms: the task's terms.
        config: its settings.

    Attributes:
        terms: those that a task with these settings has.
        policy, truth: of these, what policies observe, and the ground truth for teachers and critics.

    Raises:
        UserError: two terms of one name.
    """

    def __init__(self, terms: Iterable[Term], config: TaskConfig):
        self.config = config
        self.terms = tuple(t for t in terms if t.when(config))
        self.policy = tuple(t for t in self.terms if t.to == POLICY)
        self.truth = tuple(t for t in self.terms if t.to != POLICY)
        self._places: dict[str, slice] = {}
        for group in (self.policy, self.truth):
            first = 0
            for t in group:
                if t.name in self._places:
                    raise UserError("two observation terms share a name", got=t.name)
                self._places[t.name] = slice(first, first + t.length(config))
                first += t.length(config)

    @property
    def policy_size(self) -> int:
        """Length of the policy's part at one time step."""
        return sum(t.length(self.config) for t in self.policy)

    @property
    def truth_size(self) -> int:
        """Length of the ground truth."""
        return sum(t.length(self.config) for t in self.truth)

    @property
    def for_teachers(self) -> tuple[int, ...]:
        """Indices of the ground truth that a teacher may see."""
        places = [self[t.name] for t in self.truth if t.to == "teacher"]
        return tuple(i for place in places for i in range(place.start, place.stop))

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def __getitem__(self, name: str) -> slice:
        """Return the slice of a term in the policy's part at one time step, or in the ground truth.

        Raises:
            UserError: no such term.
        """
        if name not in self._places:
            raise UserError("no such observation term", got=name, choices=self._places)
        return self._places[name]

    def term(self, name: str) -> Term:
        """Return the term of that name. Raises UserError: no such term."""
        self[name]  # raises
        return next(t for t in self.terms if t.name == name)

    def read(self, sim: Simulation, terms: Sequence[Term]) -> np.ndarray:
        """Return the scaled values of one or more terms side by side, (nsim, sum of lengths), with their noise."""
        noisy = _noise(sim)
        parts = [scaled((t,), sim.seen if t.to == POLICY else sim, noisy) for t in terms]
        return np.concatenate(parts, axis=1)


def _noise(sim: Simulation) -> Callable[[Term, np.ndarray], np.ndarray]:
    """Return a function that adds to a term's values the noise drawn from the episodes' seeds."""

    def noisy(term: Term, value: np.ndarray) -> np.ndarray:
        if not term.noise:
            return value
        rows = zip(sim.seeds, sim.count, strict=True)
        drawn = [stream(int(s), "term", term.name, int(k)).standard_normal(value.shape[1]) for s, k in rows]
        return value + term.noise * np.stack(drawn)

    return noisy
