"""How far draws may leave nominal while a policy learns: by a schedule, or range by range as the policy copes.

A level of 0 is the nominal world, 1 the whole range; `World.sample` takes one level for all ranges or one for each.
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

TAIL = 0.025  # quantile taken for a range's end


@dataclass(frozen=True)
class Schedule:
    """A level that follows training's progress, linear between `points` and constant beyond them.

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
        """Return the level (0 to 1) at this share of training."""
        x, y = np.array(self.points, float).T
        return float(np.interp(progress, x, y))


class AdaptiveState(TypedDict):
    """How far each range is open, and the outcomes counted at its edge since it last moved."""

    levels: dict[str, float]
    outcomes: dict[str, list[bool]]


class Adaptive:
    """Automatic domain randomization: a range widens where the policy copes with its edge, narrows where it does not.

    An episode counts for a range if one of the range's parameters was drawn in the outer share `1 - edge` of what its
    present level allows (any episode does while the level is 0). After `window` of these the level rises by `step` if
    the success rate is `high` or more, and falls if it is `low` or less. Source: the algorithm of OpenAI et al. 2019,
    Solving Rubik's Cube with a Robot Hand, section 5.2; there episodes at the edge are drawn for the purpose, here
    those that chance puts there are used, so that a world remains a function of its seed and levels alone.

    Args:
        world: whose ranges are governed.
        start: level of every range at first.
        step, window, low, high, edge: see above.

    Attributes:
        levels: by label, for `World.sample`.
    """

    def __init__(
        self,
        world: RandomizedWorld,
        *,
        start: float = 0.0,
        step: float = 0.05,
        window: int = 40,
        low: float = 0.5,
        high: float = 0.9,
        edge: float = 0.75,
    ):
        for key, value in (("start", start), ("step", step), ("low", low), ("high", high), ("edge", edge)):
            if not 0 <= value <= 1:
                raise UserError("not a share", key=key, expected="0 to 1", got=value)
        if window < 1 or low >= high:
            raise UserError("not thresholds", expected="window > 0 and low < high", got=(window, low, high))
        self.step, self.window, self.low, self.high, self.edge = step, window, low, high, edge
        self.ranges = {r.label: r for r in world.ranges if any(_reaches(r, n)[2] for n in r.params)}
        self.own = {r.label for r in world.ranges}  # places that have a range to themselves are in no broad one
        self.levels = dict.fromkeys(self.ranges, float(start))
        self.outcomes: dict[str, list[bool]] = {label: [] for label in self.ranges}

    def record(self, drawn: Mapping[str, Mapping[str, float]], success: bool, levels: Mapping[str, float]) -> None:
        """Count an episode.

        Args:
            drawn: parameter values by the label of each effect, as an episode's `info["world"]` states them.
            success: of the episode.
            levels: that it was drawn with; episodes drawn with an older level of a range do not count for it.
        """
        for label, r in self.ranges.items():
            if levels.get(label) != self.levels[label]:
                continue
            if any(self._at_edge(r, values) for name, values in drawn.items() if self._governs(r, name)):
                self.outcomes[label].append(bool(success))
                self._move(label)

    def state(self) -> AdaptiveState:
        """Levels and counted outcomes, for JSON."""
        return {"levels": dict(self.levels), "outcomes": {k: [*v] for k, v in self.outcomes.items()}}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continues from what `state` gave.

        Raises:
            UserError: the state is of a world with other ranges.
        """
        if set(state["levels"]) != set(self.levels):
            other = sorted(set(state["levels"]) ^ set(self.levels))
            raise UserError("levels of another world", expected=sorted(self.levels), got=other)
        self.levels = {k: float(v) for k, v in state["levels"].items()}
        self.outcomes = {k: [bool(x) for x in v] for k, v in state["outcomes"].items()}

    def _governs(self, r: RandomizedEffect, name: str) -> bool:
        broad = r.where in MANY
        return name == r.label or broad and name.startswith(f"{r.effect}(") and name not in self.own

    def _at_edge(self, r: RandomizedEffect, values: Mapping[str, float]) -> bool:
        level = self.levels[r.label]
        for name in r.params:
            below, above, free = _reaches(r, name)
            if not free:
                continue
            away = values[name] - effect(r.effect).params[name].null
            reach = level * (above if away >= 0 else below)
            if abs(away) >= self.edge * reach - 1e-12:
                return True
        return False

    def _move(self, label: str) -> None:
        recent = self.outcomes[label]
        if len(recent) < self.window:
            return
        rate = np.mean(recent)
        change = self.step if rate >= self.high else -self.step if rate <= self.low else 0.0
        self.levels[label] = float(np.clip(round(self.levels[label] + change, 9), 0.0, 1.0))
        self.outcomes[label] = []


def _reaches(r: RandomizedEffect, name: str) -> tuple[float, float, bool]:
    """How far (below, above) null a parameter goes at level 1, and whether a level moves it at all."""
    spec: float | Distribution = r.params[name]
    param = effect(r.effect).params[name]
    if isinstance(spec, int | float) or param.shape:
        return 0.0, 0.0, False
    low, high = spec.at(TAIL), spec.at(1 - TAIL)
    return max(param.null - low, 0.0), max(high - param.null, 0.0), True


__all__ = ["Adaptive", "Schedule"]
