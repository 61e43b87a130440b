"""Episodes that begin as trials began: played by the policy, or by the actions that a trial recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vispeg.task.start import Start


@dataclass(frozen=True, eq=False)
class Replays:
    """How the episodes of a job begin, by their seeds.

    Attributes:
        starts: seed -> start.
        actions: seed -> (n, k) actions, one a step, in place of the policy's; empty where the policy acts.
    """

    starts: Mapping[int, Start]
    actions: Mapping[int, np.ndarray] = field(default_factory=dict)


class Begun:
    """An environment whose episodes begin as their seed's trial began."""

    def __init__(self, env: Any, replays: Replays):
        self.env, self.replays, self.num_envs = env, replays, env.num_envs
        self._actions: list[np.ndarray | None] = [None] * env.num_envs
        self._step = np.zeros(env.num_envs, int)

    def reset(self, *, seed: Any = None, options: Mapping[str, Any] | None = None) -> Any:
        """As the environment's; rows whose seed is no trial's begin by their seed."""
        rows = np.flatnonzero((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        starts: list[Start | None] = [None] * self.num_envs
        for row in rows.tolist():
            starts[row] = self.replays.starts.get(int(seed[row]))
            self._actions[row], self._step[row] = self.replays.actions.get(int(seed[row])), 0
        return self.env.reset(seed=seed, options={**(options or {}), "start": starts})

    def step(self, actions: np.ndarray) -> Any:
        """As the environment's; a row with recorded actions takes those, and stays where it is after the last one."""
        actions = np.array(actions, np.float32)
        for row, recorded in enumerate(self._actions):
            if recorded is not None:
                step = self._step[row]
                actions[row] = recorded[step] if step < len(recorded) else 0.0
        self._step += 1
        return self.env.step(actions)
