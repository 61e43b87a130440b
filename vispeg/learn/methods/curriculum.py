"""Curriculum: the stages of a run, easiest first, and when it moves to the next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.learn.config import Stage
from vispeg.task.config import TaskConfig


class Curriculum:
    """The stages of a run, and the index `at` of the present one.

    Args:
        stages: the stages in order; the last one is the task that is trained for.
        pass_rate: success rate that moves the run to the next stage.
    """

    def __init__(self, stages: Sequence[Stage], pass_rate: float):
        self.stages, self.pass_rate, self.at = tuple(stages), pass_rate, 0

    @property
    def stage(self) -> Stage:
        """The present stage."""
        return self.stages[self.at]

    @property
    def last(self) -> bool:
        """Whether the present stage is the last one."""
        return self.at == len(self.stages) - 1

    def after(self, success: float) -> bool:
        """Move to the next stage if an evaluation's success rate is high enough; return whether it moved."""
        if self.last or success < self.pass_rate:
            return False
        self.at += 1
        return True

    def settings(self, settings: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the task's settings at this stage: the run's, with those that the stage replaces."""
        radius = {} if self.stage.radius is None else {"start_radius": self.stage.radius}
        return {**settings, **self.stage.settings, **radius}


def stages(tolerances: Sequence[float], radii: Sequence[float], task: TaskConfig) -> tuple[Stage, ...]:
    """Return stages that narrow the tolerance and move the start away; the last one is the task itself.

    If there are easier stages, the first draws from half of every range of the world, all others from the full ranges.

    Args:
        tolerances: tolerances of the stages before the last, widest first, in the unit of the task's own.
        radii: lateral ranges of their starts, m, nearest first. The shorter list is filled up with the task's value.
        task: the task that is trained for; either list may end with its value, which then gives no stage of its own.

    Raises:
        UserError: a list is out of order or goes past the task's own value, or the task has no tolerance to widen.
    """
    wide = _wide(tolerances, task)
    near_first = f"above 0, nearest first, below the {task.start_radius:g} m that are trained for"
    near = _towards(radii, 0.0, task.start_radius, "--start-radius", near_first)
    easier = enumerate(zip_longest(wide, near))
    return (*(Stage(width or {}, radius, level=1.0 if i else 0.5) for i, (width, radius) in easier), Stage())


def _wide(tolerances: Sequence[float], task: TaskConfig) -> list[dict[str, float]]:
    """Return the tolerance of each easier stage as {setting: value}."""
    if not tolerances:
        return []
    if task.tolerance is None:
        raise UserError("this task has no tolerance that stages could widen", key="--curriculum", got=tuple(tolerances))
    name, target = task.tolerance.setting, getattr(task, task.tolerance.setting)
    order = f"widest first, above the {target:g} {task.tolerance.unit} that are trained for"
    return [{name: value} for value in _towards(tolerances, np.inf, target, "--curriculum", order)]


def _towards(values: Sequence[float], easiest: float, target: float, key: str, order: str) -> list[float]:
    """Return the values without a last one equal to `target`; they must be monotonic from `easiest` to `target`.

    Raises:
        UserError: they are not; `order` says what is expected of the option `key`.
    """
    before = [*values[:-1], *(v for v in values[-1:] if v != target)]
    steps = np.diff([easiest, *before, target])
    if len(values) and not (np.all(steps > 0) or np.all(steps < 0)):
        raise UserError("stages must become harder", key=key, expected=order, got=tuple(values))
    return before
