"""Levels that scale how far a world's ranges extend from nominal during training: by a schedule, or adaptively.

At level 0 a drawn parameter is nominal, at 1 it has its whole range. Levels do not change fixed numbers and shape
parameters. `RandomizedWorld.sample` takes one level for all ranges, or one for each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.worlds.distribution import Distribution
from vispeg.worlds.places import MANY
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld

LOW, HIGH = 0.5, 0.9  # shares of success from which a range narrows, and widens
EDGE = 0.75  # share of a range from which on values are at its edge
TAIL = 0.025  # quantile that counts as a range's lower end, as 1 - TAIL does as its upper end


@dataclass(frozen=True)
class Schedule:
    """A level as a function of training's progress: linear between `points` and constant beyond them.

    Attributes:
        points: (progress, level) pairs, progress rising, both 0 to 1.
    """

    points: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.5, 1.0))

    def __post_init__(self) -> None:
        at = np.array(self.points, float)
        ok = at.ndim == 2 and at.shape[1] == 2 and len(at) > 0 and bool(np.all((at >= 0) & (at <= 1)))
        if not ok or np.any(np.diff(at[:, 0]) <= 0):
            expected = "(progress, level) pairs from 0 to 1, progress rising"
            raise UserError("not a schedule", key="points", expected=expected, got=self.points)

    def __call__(self, progress: float) -> float:
        """Return the level (0 to 1) at a progress of training (0 to 1)."""
        x, y = np.array(self.points, float).T
        return float(np.interp(progress, x, y))


class AdaptiveState(TypedDict):
    """State of Adaptive, by range: its level, and whether each episode at its edge since its last change succeeded."""

    levels: dict[str, float]
    outcomes: dict[str, list[bool]]


class Adaptive:
    """Automatic domain randomization: a range widens if the policy succeeds at its edge, and narrows if it fails there.

    An episode is at the edge of a range if one of the range's parameters lies in the outer share `1 - EDGE` of the
    values that the present level allows (at level 0 every episode is). After `window` such episodes, the level rises by
    `step` if at least the share HIGH of them succeeded, and falls by `step` if at most the share LOW did. Source:
    OpenAI et al. 2019, Solving Rubik's Cube with a Robot Hand, section 5.2. There, episodes are put at the edge on
    purpose. Here they are at the edge by chance, so that a world depends only on its seed and levels.

    Args:
        world: the world whose ranges are scaled.
        start: initial level of every range.
        step, window: see above.

    Attributes:
        levels: range's label -> level, for `RandomizedWorld.sample`.
    """

    def __init__(
        self,
        world: RandomizedWorld,
        *,
        start: float = 0.0,
        step: float = 0.05,
        window: int = 40,
    ):
        self.step, self.window = step, window
        self.ranges = {r.label: r for r in world.ranges if any(_sides(r, n) for n in r.params)}
        self.labels = {r.label for r in world.ranges}
        self.levels = dict.fromkeys(self.ranges, float(start))
        self.outcomes: dict[str, list[bool]] = {label: [] for label in self.ranges}

    def record(self, drawn: Mapping[str, Mapping[str, float]], success: bool, levels: Mapping[str, float]) -> None:
        """Count an episode, and change levels that have enough episodes.

        Args:
            drawn: effect's label -> parameter -> value, as in an episode's `info["world"]`.
            success: whether the episode succeeded.
            levels: the levels with which it was drawn; it does not count for ranges whose level has changed since.
        """
        for label, r in self.ranges.items():
            if levels.get(label) != self.levels[label]:
                continue
            if any(self._at_edge(r, values) for name, values in drawn.items() if self._governs(r, name)):
                self.outcomes[label].append(bool(success))
                self._move(label)

    def state(self) -> AdaptiveState:
        """Return levels and counted outcomes, ready for JSON."""
        return {"levels": dict(self.levels), "outcomes": {k: [*v] for k, v in self.outcomes.items()}}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore levels and outcomes from what `state` returned.

        Raises:
            UserError: the state belongs to a world with other ranges.
        """
        if set(state["levels"]) != set(self.levels):
            other = sorted(set(state["levels"]) ^ set(self.levels))
            raise UserError("levels of another world", expected=sorted(self.levels), got=other)
        self.levels = {k: float(v) for k, v in state["levels"].items()}
        self.outcomes = {k: [bool(x) for x in v] for k, v in state["outcomes"].items()}

    def _governs(self, r: RandomizedEffect, name: str) -> bool:
        """Say whether the effect labelled `name` was drawn from a range; a range of one place precedes one of many."""
        return name == r.label or (r.where in MANY and name.startswith(f"{r.effect}(") and name not in self.labels)

    def _at_edge(self, r: RandomizedEffect, values: Mapping[str, float]) -> bool:
        """Say whether a drawn parameter lies in the outer share `1 - EDGE` of what the present level allows."""
        level = self.levels[r.label]
        for name in r.params:
            sides = _sides(r, name)
            if sides is None:
                continue
            distance = values[name] - effect(r.effect).params[name].null
            near, far = sides[int(distance >= 0)]
            if abs(distance) >= level * (near + EDGE * (far - near)) - 1e-12:
                return True
        return False

    def _move(self, label: str) -> None:
        """Change a range's level if it has `window` outcomes."""
        recent = self.outcomes[label]
        if len(recent) < self.window:
            return
        rate = np.mean(recent)
        change = self.step if rate >= HIGH else -self.step if rate <= LOW else 0.0
        # rounded, so that levels stay multiples of the step
        self.levels[label] = float(np.clip(round(self.levels[label] + change, 9), 0.0, 1.0))
        self.outcomes[label] = []


def _sides(r: RandomizedEffect, name: str) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return the (nearest, farthest) distance from null of a parameter's range at level 1, below null and above it.

    The nearest is 0 if the range contains null. None for a parameter that levels do not scale.
    """
    spec: float | Distribution = r.params[name]
    param = effect(r.effect).params[name]
    if isinstance(spec, int | float) or param.shape:
        return None
    low, high = spec.at(TAIL) - param.null, spec.at(1 - TAIL) - param.null
    return (max(-high, 0.0), max(-low, 0.0)), (max(low, 0.0), max(high, 0.0))
