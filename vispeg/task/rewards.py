"""Reward terms: what a policy step is rewarded for, by name; a reward is a weight for each of some terms.

A world file chooses: `reward: shaped`, one of the task's rewards by name, or weights of the user's own,

    task:
      reward: {distance: -0.5, force: -0.2, success: 5}

Two terms are events, added once to an episode's last step: `success`, and `abort` where the episode ended in a failure
before its time.
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
    ABORT: "1 at the end of one that fails before its time is out",
}


@dataclass(frozen=True)
class Moment:
    """Inputs of a reward at one step.

    Attributes:
        tip: (n, 3) in the goal's frame, m.
        goal: (3,) there, m.
        force: (n,) largest contact force of the step, N.
        action: (n, k), each entry within +-1.
        scale: the task's `reward_scale`, m.
        sim: the TaskSimulation, for terms of a task's own.
    """

    tip: np.ndarray
    goal: np.ndarray
    force: np.ndarray
    action: np.ndarray
    scale: float
    sim: Any = None


@dataclass(frozen=True)
class RewardTerm:
    """One term: `value`, moment -> (n,), near 1, and what it is in one line."""

    name: str
    value: Callable[[Moment], np.ndarray]
    about: str


@dataclass(frozen=True)
class Reward:
    """A weighted sum of terms.

    Attributes:
        parts: each term with its weight, in the order of the sum.
        success, abort: what an episode's end adds.
    """

    parts: tuple[tuple[RewardTerm, float], ...]
    success: float = 0.0
    abort: float = 0.0

    def dense(self, m: Moment) -> np.ndarray:
        """(n,) of a step, without its events."""
        total = np.zeros(len(m.tip))
        for term, weight in self.parts:
            total += weight * term.value(m)
        return total


@dataclass(frozen=True)
class Rewards:
    """The terms that a task has, and the rewards that it names.

    Attributes:
        terms: of the task; the two events are every task's.
        named: weights by term, by the reward's name.
    """

    terms: tuple[RewardTerm, ...]
    named: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def of(self, choice: str | tuple[tuple[str, float], ...]) -> Reward:
        """Give the reward of a name, or of weights by term.

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
        """Give a reward as a file states it: a name, a mapping of weights, or their pairs as JSON keeps them.

        Raises:
            UserError: something else.
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
