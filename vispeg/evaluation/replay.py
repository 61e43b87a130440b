"""Play episodes that begin in the state of a recorded trial, with the policy's actions or with those of the trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vispeg.task.start import Start


@dataclass(frozen=True, eq=False)
class Replays:
    """Trials to replay: the seed of an episode says which trial it replays.

    Attributes:
        starts: seed -> state in which the trial began; episodes of other seeds begin as their seed draws.
        actions: seed -> the trial's actions (n, k), one per step; in episodes of other seeds the policy acts.
    """

    starts: Mapping[int, Start]
    actions: Mapping[int, np.ndarray] = field(default_factory=dict)


class Begun:
    """A batch of environments whose episodes replay trials.

    Args:
        env: the batch; its `reset` takes the option `start`.
        replays: the trials.
    """

    def __init__(self, env: Any, replays: Replays):
        self.env, self.replays, self.num_envs = env, replays, env.num_envs
        self._actions: list[np.ndarray | None] = [None] * env.num_envs
        self._step = np.zeros(env.num_envs, int)

    def reset(self, *, seed: Any = None, options: Mapping[str, Any] | None = None) -> Any:
        """Reset the environments, or those in the option `reset_mask`; `seed` holds one seed per environment."""
        rows = np.flatnonzero((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        starts: list[Start | None] = [None] * self.num_envs
        for row in rows.tolist():
            starts[row] = self.replays.starts.get(int(seed[row]))
            self._actions[row], self._step[row] = self.replays.actions.get(int(seed[row])), 0
        return self.env.reset(seed=seed, options={**(options or {}), "start": starts})

    def step(self, actions: np.ndarray) -> Any:
        """Step all environments by `actions` (n, k).

        Environments that replay a trial's actions take those instead, and zeros after the last one.
        """
        actions = np.array(actions, np.float32)
        for row, recorded in enumerate(self._actions):
            if recorded is not None:
                step = self._step[row]
                actions[row] = recorded[step] if step < len(recorded) else 0.0
        self._step += 1
        return self.env.step(actions)
