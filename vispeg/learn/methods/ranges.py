"""Widen the ranges of the training world during a run. Evaluations always draw from the full ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from vispeg.core.errors import UserError
from vispeg.worlds.adaptive import Adaptive, Schedule
from vispeg.worlds.randomized import RandomizedWorld

Levels = float | dict[str, float]  # one level for all ranges, or range's label -> level; 0: nominal, 1: the full range


class Opening:
    """The levels from which a run's training episodes are drawn.

    During the random actions at the start, all ranges are full, because the observations of those steps set the
    networks' input scales for the whole run.

    Args:
        kind: `schedule`, one level for all ranges, which rises with the run's steps; or `adaptive`, a level for each
            range, which follows the policy's success.
        world: the world with the ranges.
        steps: the run's number of steps.
        random: number of steps with random actions at the start.

    Raises:
        UserError: the world has no range that a level changes.
    """

    def __init__(self, kind: str, world: RandomizedWorld, steps: int, random: int):
        adaptive = Adaptive(world)
        if not adaptive.levels:
            raise UserError("nothing varies in this world", key="ranges", expected="full", got=kind)
        self.adaptive = adaptive if kind == "adaptive" else None
        self.schedule, self.steps, self.random = Schedule(), steps, random
        self.levels: Levels = 1.0  # levels of the episodes that begin next
        self.drawn: list[Levels] = []  # for each environment of the batch, the levels of its present episode

    def begin(self, env: VecEnv, step: int) -> None:
        """Set the levels for this step of the run; to be called before all environments of the batch are reset."""
        self._set(env, step)
        self.drawn = [self.levels] * env.num_envs

    def after(self, env: VecEnv, step: int, dones: np.ndarray, infos: Sequence[Mapping[str, Any]]) -> None:
        """Update the levels after a step of all n environments.

        Args:
            env: the batch; environments whose episode ended have already been reset.
            step: number of steps of the run so far.
            dones: (n,) bool, whether an episode ended.
            infos: (n,) the environments' infos, which for an ended episode hold its sampled world and its success.
        """
        for row in np.flatnonzero(dones).tolist():
            drawn, self.drawn[row] = self.drawn[row], self.levels
            if self.adaptive is not None and isinstance(drawn, dict):
                self.adaptive.record(infos[row]["record"]["world"], bool(infos[row]["success"]), drawn)
        self._set(env, step)

    @property
    def level(self) -> float:
        """The level of the episodes that begin next, 0 to 1; of `adaptive` ranges the mean."""
        return float(np.mean([*self.levels.values()])) if isinstance(self.levels, dict) else self.levels

    def state(self) -> Mapping[str, object]:
        """Return the state for a checkpoint, as JSON data.

        It holds the run's number of steps, so a run that is resumed with more steps keeps its schedule.
        """
        return {"steps": self.steps, **(self.adaptive.state() if self.adaptive is not None else {})}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned. Raises UserError if it comes from a world with other ranges."""
        self.steps = int(state["steps"])
        if self.adaptive is not None:
            self.adaptive.restore(state)

    def _set(self, env: VecEnv, step: int) -> None:
        """Compute the levels at a step of the run, and pass them to the environments for their next episodes."""
        if step < self.random:
            self.levels = 1.0
        elif self.adaptive is None:
            self.levels = self.schedule(step / self.steps)
        else:
            self.levels = dict(self.adaptive.levels)
        env.env_method("set_level", self.levels)
