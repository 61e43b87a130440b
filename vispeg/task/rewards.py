"""Rewards: weighted sums of named reward terms.

A world file chooses one of the task's rewards by name (`reward: shaped`), or states weights of its own:

    task:
      reward: {distance: -0.5, force: -0.2, success: 5}

Two terms are events that are added once, to an episode's last step: `success`, and `abort` if the episode failed before
its time was over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vispeg.core.errors import UserError

SUCCESS, ABORT = "success", "abort"
EVENTS = {
    SUCCESS: "1 at the end of an episode that succeeds",
    ABORT: "1 at the end of an episode that fails before its time is over",
}


@dataclass(frozen=True)
class Moment:
    """Inputs of a reward at one step.

    Attributes:
        tip: (n, 3) true position of the tip in the goal's frame, m.
        goal: (3,) position that the tip is to reach, same frame, m.
        force: (n,) largest contact force of the step, N.
        action: (n, k), each entry within +-1.
        scale: the task's `reward_scale`, m.
        sim: the TaskSimulation, for reward terms that a task adds.
    """

    tip: np.ndarray
    goal: np.ndarray
    force: np.ndarray
    action: np.ndarray
    scale: float
    sim: Any = None


@dataclass(frozen=True)
class RewardTerm:
    """One reward term.

    Attributes:
        name: of the term.
        value: function that returns the term (n,), of order 1, for a Moment.
        about: one line of description.
    """

    name: str
    value: Callable[[Moment], np.ndarray]
    about: str


@dataclass(frozen=True)
class Reward:
    """A weighted sum of terms.

    Attributes:
        parts: each term with its weight, in the order of the sum.
        success, abort: added to the last step of an episode that succeeds, or fails before its time is over.
    """

    parts: tuple[tuple[RewardTerm, float], ...]
    success: float = 0.0
    abort: float = 0.0

    def dense(self, m: Moment) -> np.ndarray:
        """Return the reward (n,) of a step, without events."""
        total = np.zeros(len(m.tip))
        for term, weight in self.parts:
            total += weight * term.value(m)
        return total


@dataclass(frozen=True)
class Rewards:
    """The reward terms of a task, and its named rewards.

    Attributes:
        terms: of the task; every task also has the two events.
        named: reward's name -> term's name -> weight.
    """

    terms: tuple[RewardTerm, ...]
    named: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def of(self, choice: str | tuple[tuple[str, float], ...]) -> Reward:
        """Return the reward for its name or for (term, weight) pairs.

        Raises:
            UserError: an unknown reward or term, a weight that is not finite.
        """
        if isinstance(choice, str):
            if choice not in self.named:
                raise UserError("unknown reward", key="reward", got=choice, choices=self.named)
            weights = dict(self.named[choice])
        else:
            weights = dict(choice)
        terms = {t.name: t for t in self.terms}
        for name, weight in weights.items():
            if name not in terms and name not in EVENTS:
                raise UserError("unknown reward term", key="reward", got=name, choices=(*terms, *EVENTS))
            if not math.isfinite(weight):
                raise UserError("not finite", key=f"reward.{name}", expected="a weight", got=weight)
        dense = tuple((terms[name], weight) for name, weight in weights.items() if name in terms)
        return Reward(dense, weights.get(SUCCESS, 0.0), weights.get(ABORT, 0.0))

    def read(self, value: Any, file: str | None, key: str) -> str | tuple[tuple[str, float], ...]:
        """Read a reward from a file's value: a name, a mapping of weights, or pairs (in JSON) of term and weight.

        Returns:
            The name, or the pairs of term and weight.

        Raises:
            UserError: any other value.
        """
        if isinstance(value, str):
            return value
        try:
            pairs = tuple((name, weight) for name, weight in (value.items() if isinstance(value, Mapping) else value))
        except (TypeError, ValueError):
            pairs = ()
        if not pairs or not all(isinstance(n, str) and _number(w) for n, w in pairs):
            expected = "a reward's name, or a weight for each term"
            raise UserError("wrong reward", file=file, key=key, expected=expected, got=value)
        return tuple((name, float(weight)) for name, weight in pairs)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
