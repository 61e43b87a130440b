"""Play episodes that begin as trials began, with the policy's actions or with those that a trial recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vispeg.task.start import Start


@dataclass(frozen=True, eq=False)
class Replays:
    """The starts and actions of a job's episodes.

    Attributes:
        starts: seed -> start.
        actions: seed -> recorded actions (n, k), one per step; the policy acts in episodes of other seeds.
    """

    starts: Mapping[int, Start]
    actions: Mapping[int, np.ndarray] = field(default_factory=dict)


class Begun:
    """An environment in which an episode begins as the trial of its seed began."""

    def __init__(self, env: Any, replays: Replays):
        self.env, self.replays, self.num_envs = env, replays, env.num_envs
        self._actions: list[np.ndarray | None] = [None] * env.num_envs
        self._step = np.zeros(env.num_envs, int)

    def reset(self, *, seed: Any = None, options: Mapping[str, Any] | None = None) -> Any:
        """Reset as the environment does; rows whose seed has a trial begin as that did, others as their seed draws."""
        rows = np.flatnonzero((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        starts: list[Start | None] = [None] * self.num_envs
        for row in rows.tolist():
            starts[row] = self.replays.starts.get(int(seed[row]))
            self._actions[row], self._step[row] = self.replays.actions.get(int(seed[row])), 0
        return self.env.reset(seed=seed, options={**(options or {}), "start": starts})

    def step(self, actions: np.ndarray) -> Any:
        """Step as the environment does; rows with recorded actions take those, and zero actions after the last one."""
        actions = np.array(actions, np.float32)
        for row, recorded in enumerate(self._actions):
            if recorded is not None:
                step = self._step[row]
                actions[row] = recorded[step] if step < len(recorded) else 0.0
        self._step += 1
        return self.env.step(actions)
