"""Open the world's ranges while a run trains. Evaluations always draw from the full ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from vispeg.core.errors import UserError
from vispeg.worlds.adaptive import Adaptive, Schedule
from vispeg.worlds.randomized import RandomizedWorld

Levels = float | dict[str, float]  # level of all ranges, or of each by label: 0 is the nominal world, 1 the full range


class Opening:
    """Open ranges while a run trains: `schedule` by its steps, `adaptive` by its policy's success.

    They are fully open during the random actions at the start, because those observations set the networks' input
    scales for the whole run.

    Args:
        kind: `schedule` or `adaptive`.
        world: the world with the ranges.
        steps: the run's number of steps.
        random: number of steps with random actions at the start.

    Raises:
        UserError: nothing varies in this world.
    """

    def __init__(self, kind: str, world: RandomizedWorld, steps: int, random: int):
        adaptive = Adaptive(world)
        if not adaptive.levels:
            raise UserError("nothing varies in this world", key="ranges", expected="full", got=kind)
        self.adaptive = adaptive if kind == "adaptive" else None
        self.schedule, self.steps, self.random = Schedule(), steps, random
        self.levels: Levels = 1.0  # levels of the episodes that begin next
        self.drawn: list[Levels] = []  # levels of each row's present episode

    def begin(self, env: VecEnv, step: int) -> None:
        """Set the levels before all rows are reset at this step of the run."""
        self._set(env, step)
        self.drawn = [self.levels] * env.num_envs

    def after(self, env: VecEnv, step: int, dones: np.ndarray, infos: Sequence[Mapping[str, Any]]) -> None:
        """Update the levels after a step of every row; rows with `dones` (n,) have already been reset."""
        for row in np.flatnonzero(dones).tolist():
            drawn, self.drawn[row] = self.drawn[row], self.levels
            if self.adaptive is not None and isinstance(drawn, dict):
                self.adaptive.record(infos[row]["record"]["world"], bool(infos[row]["success"]), drawn)
        self._set(env, step)

    @property
    def level(self) -> float:
        """The level of the episodes that begin next, 0 to 1; the mean over ranges that have levels of their own."""
        return float(np.mean([*self.levels.values()])) if isinstance(self.levels, dict) else self.levels

    def state(self) -> Mapping[str, object]:
        """Return the state for a checkpoint, as JSON data. It has the steps, so a prolonged run keeps its schedule."""
        return {"steps": self.steps, **(self.adaptive.state() if self.adaptive is not None else {})}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned. Raises UserError if it comes from a world with other ranges."""
        self.steps = int(state["steps"])
        if self.adaptive is not None:
            self.adaptive.restore(state)

    def _set(self, env: VecEnv, step: int) -> None:
        if step < self.random:
            self.levels = 1.0
        elif self.adaptive is None:
            self.levels = self.schedule(step / self.steps)
        else:
            self.levels = dict(self.adaptive.levels)
        env.env_method("set_level", self.levels)
