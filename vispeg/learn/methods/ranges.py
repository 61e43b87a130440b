"""How far training's episodes may leave nominal, from step to step. Evaluations are always at the full ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from vispeg.core.errors import UserError
from vispeg.worlds.adaptive import Adaptive, Schedule
from vispeg.worlds.randomized import RandomizedWorld

Levels = float | dict[str, float]  # of all ranges, or by label


class Opening:
    """Ranges that open while a run goes on: `schedule` by its steps, `adaptive` as its policy copes.

    They are open whole while actions are random, because what is seen then sets the networks' input scales for good.

    Args:
        kind: `schedule` or `adaptive`.
        world: whose ranges they are.
        steps: of the run.
        random: steps of random actions that it begins with.

    Raises:
        UserError: nothing varies in this world.
    """

    def __init__(self, kind: str, world: RandomizedWorld, steps: int, random: int):
        adaptive = Adaptive(world)
        if not adaptive.levels:
            raise UserError("nothing varies in this world", key="ranges", expected="full", got=kind)
        self.adaptive = adaptive if kind == "adaptive" else None
        self.schedule, self.steps, self.random = Schedule(), steps, random
        self.levels: Levels = 1.0  # of the episodes that begin next
        self.drawn: list[Levels] = []  # of each row's present episode

    def begin(self, env: VecEnv, step: int) -> None:
        """Note that all rows are about to be reset at this step of the run."""
        self._set(env, step)
        self.drawn = [self.levels] * env.num_envs

    def after(self, env: VecEnv, step: int, dones: np.ndarray, infos: Sequence[Mapping[str, Any]]) -> None:
        """Update after a step of every row, rows that are done (n,) have already been reset."""
        for row in np.flatnonzero(dones).tolist():
            drawn, self.drawn[row] = self.drawn[row], self.levels
            if self.adaptive is not None and isinstance(drawn, dict):
                self.adaptive.record(infos[row]["record"]["world"], bool(infos[row]["success"]), drawn)
        self._set(env, step)

    @property
    def level(self) -> float:
        """Of the episodes that begin next, 0 to 1; of ranges that go each by itself, the mean."""
        return float(np.mean([*self.levels.values()])) if isinstance(self.levels, dict) else self.levels

    def state(self) -> Mapping[str, object]:
        """For a checkpoint, as JSON. A run that is prolonged keeps its schedule."""
        return {"steps": self.steps, **(self.adaptive.state() if self.adaptive is not None else {})}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Goes on from what `state` gave. Raises UserError if that is of a world with other ranges."""
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
