"""Easier worlds first: the stages of a run and when it moves on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.learn.config import Stage
from vispeg.task.config import TaskConfig


class Curriculum:
    """Where a run stands in its stages.

    Args:
        stages: in order; the last one is what is trained for.
        pass_rate: success rate that moves on to the next.
    """

    def __init__(self, stages: Sequence[Stage], pass_rate: float):
        self.stages, self.pass_rate, self.at = tuple(stages), pass_rate, 0

    @property
    def stage(self) -> Stage:
        """The present one."""
        return self.stages[self.at]

    @property
    def last(self) -> bool:
        """Whether the present stage is what is trained for."""
        return self.at == len(self.stages) - 1

    def after(self, success: float) -> bool:
        """Move on if an evaluation's success rate allows; return whether it did."""
        if self.last or success < self.pass_rate:
            return False
        self.at += 1
        return True

    def settings(self, settings: Mapping[str, Any]) -> Mapping[str, Any]:
        """Give the task's settings at this stage, from the run's own."""
        radius = {} if self.stage.radius is None else {"start_radius": self.stage.radius}
        return {**settings, **self.stage.settings, **radius}


def stages(tolerances: Sequence[float], radii: Sequence[float], task: TaskConfig) -> tuple[Stage, ...]:
    """Stages that narrow the tolerance, move the start away and open the world; the last one is the task as it is.

    The first has half of every range, all others have all of it.

    Args:
        tolerances: of the stages before the last, widest first, in the unit of the task's own.
        radii: lateral ranges of their starts, m, nearest first. Where one list is shorter, the task's own value stands.
        task: what is trained for; either list may end with its value, which is not trained for twice.

    Raises:
        UserError: a list is out of order, or does not lead to the task's own value; a task without a tolerance.
    """
    wide = _wide(tolerances, task)
    near_first = f"above 0, nearest first, below the {task.start_radius:g} m that are trained for"
    near = _towards(radii, 0.0, task.start_radius, "--start-radius", near_first)
    easier = enumerate(zip_longest(wide, near))
    return (*(Stage(some or {}, radius, level=1.0 if i else 0.5) for i, (some, radius) in easier), Stage())


def _wide(tolerances: Sequence[float], task: TaskConfig) -> list[dict[str, float]]:
    """Give the setting of each stage that has one of its own."""
    if not tolerances:
        return []
    if task.tolerance is None:
        raise UserError("this task has no tolerance to begin wider with", key="--curriculum", got=tuple(tolerances))
    name, target = task.tolerance.setting, getattr(task, task.tolerance.setting)
    order = f"widest first, above the {target:g} {task.tolerance.unit} that are trained for"
    return [{name: value} for value in _towards(tolerances, np.inf, target, "--curriculum", order)]


def _towards(values: Sequence[float], easiest: float, target: float, key: str, order: str) -> list[float]:
    """Give the values without `target` at their end; they must go one way from `easiest` to it."""
    before = [*values[:-1], *(v for v in values[-1:] if v != target)]
    steps = np.diff([easiest, *before, target])
    if len(values) and not (np.all(steps > 0) or np.all(steps < 0)):
        raise UserError("not stages that become harder", key=key, expected=order, got=tuple(values))
    return before
