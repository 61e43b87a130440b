"""Easier worlds first: the stages of a run and when it moves on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vispeg.learn.config import Stage


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
        """Moves on if an evaluation's success rate allows; returns whether it did."""
        if self.last or success < self.pass_rate:
            return False
        self.at += 1
        return True

    def settings(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """The task's settings at this stage, from the run's own."""
        own = {"clearance_mm": self.stage.clearance_mm, "start_radius": self.stage.radius}
        return {**given, **{key: value for key, value in own.items() if value is not None}}


def clearances(values: Sequence[float]) -> tuple[Stage, ...]:
    """Stages that narrow the hole and open the world: half the ranges at first, all of them once the second stage is
    reached.

    `values` are diametral clearances in mm, widest first; none gives the task as it is.
    """
    if not values:
        return (Stage(),)
    return tuple(Stage(value, level=0.5 if i == 0 and len(values) > 1 else 1.0) for i, value in enumerate(values))
