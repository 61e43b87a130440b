"""Controls: play a policy with manipulated images or a fixed goal, to learn what its success depends on.

* `shuffled`: every episode is shown the images of another episode. A policy that uses its images must fail.
* `frozen`: the first image is shown for the whole episode. The success that remains needs only that image.
* `GOAL_fixed`, where GOAL is the cell's name of the goal: the goal is at its nominal place in every episode (a change
  of the world). A policy that succeeds only here has learnt the place and does not look.

A fourth control is a separate policy without images: modality `proprio`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.evaluation.overlay import Change
from vispeg.render.image_kinds import kind_of
from vispeg.robots.scene import Scene

SHUFFLED, FROZEN = ON_IMAGES = ("shuffled", "frozen")
FIXED = "_fixed"  # ending of the name of the control that keeps the goal at its nominal place


def controls_of(scene: Scene) -> tuple[str, ...]:
    """Return the names of the controls in a cell; `GOAL_fixed` only where an effect can move the goal."""
    return *ON_IMAGES, *([scene.goal + FIXED] if effect(scene.offset).targets(scene) else [])


def at_nominal(scene: Scene) -> Change:
    """Return the change that keeps a cell's goal at its nominal position."""
    return Change(scene.offset, {"x": 0.0, "y": 0.0, "z": 0.0})


class Controlled:
    """A policy that is shown other images than the present ones of its episode.

    Shuffled images are those of another row; of a single row those of the episode before, at that step or its last.

    Args:
        policy: the policy to control; this object has the same interface.
        control: SHUFFLED or FROZEN.
        rows: number of rows that it acts on.

    Attributes:
        spare: number of episodes to play first that do not count, since they are shown their own images.

    Raises:
        UserError: another control; in `act`, a single row to shuffle where `rows` are more.
    """

    def __init__(self, policy: Any, control: str, rows: int):
        if control not in ON_IMAGES:
            raise UserError("unknown control", got=control, choices=ON_IMAGES)
        self.policy, self.control = policy, control
        self.spare = int(control == SHUFFLED and rows == 1)
        self.modality, self.meta = policy.modality, policy.meta
        self._kept: dict[str, np.ndarray] = {}
        self._fresh = np.ones(0, dtype=bool)
        self._before: list[Mapping[str, np.ndarray]] = []  # images of a single row, a step each: the episode before
        self._now: list[Mapping[str, np.ndarray]] = []  # and this one

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Begin new episodes in all n rows, or only in those where `rows` (n,) is True."""
        if rows is None or len(self._fresh) != n:
            self._fresh = np.ones(n, dtype=bool)
        else:
            self._fresh |= rows
        if self._fresh.all():
            self._before, self._now = self._now, []
        self.policy.reset(n, rows)

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the policy's actions for the observation with the control's images."""
        images = {key: value for key, value in obs.items() if kind_of(key) is not None}
        shown = self._another(images) if self.control == SHUFFLED else {k: self._first(k, images[k]) for k in images}
        self._fresh[:] = False
        return self.policy.act({**obs, **shown})

    def _another(self, images: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """Return images of other episodes in place of these (n, ...)."""
        if all(len(each) > 1 for each in images.values()):
            return {key: np.roll(each, 1, axis=0) for key, each in images.items()}
        if not self._before and not self.spare:
            raise UserError("a single episode cannot be shown another's images", expected="two or more rows")
        self._now.append({key: each.copy() for key, each in images.items()})
        other = self._before or self._now
        return other[min(len(self._now), len(other)) - 1]  # at this step, or the last if that episode was shorter

    def _first(self, key: str, images: np.ndarray) -> np.ndarray:
        """Return the first images of the episodes in place of these (n, ...)."""
        held = self._kept.get(key)
        if held is None or held.shape != images.shape:
            held = self._kept[key] = images.copy()
        held[self._fresh] = images[self._fresh]
        return held.copy()
