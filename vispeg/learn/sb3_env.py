"""Adapt a gymnasium vector environment to Stable-Baselines3: a row whose episode ends is reset in the same step."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from stable_baselines3.common.vec_env import VecEnv

from vispeg.learn.infos import row_info
from vispeg.task.start import Start


class Sb3Env(VecEnv):
    """Adapt a batched environment whose `reset` takes `options={"reset_mask": (n,) bool}`, as gymnasium's own do.

    A row whose episode ends is reset in the same step. The episode's last observation is in its info as
    `terminal_observation`; `TimeLimit.truncated` says whether only the time limit ended it.

    Args:
        env: the environment.
        starts: starts of the episodes, used in turn; empty for those that the seeds draw.
    """

    def __init__(self, env: VectorEnv, starts: Sequence[Start] = ()):
        self.env, self._starts = env, cycle(starts) if starts else None
        self.render_mode = getattr(env, "render_mode", None)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._actions = np.zeros((env.num_envs, 1))

    def reset(self) -> dict[str, np.ndarray]:
        """Reset all rows, with the seed set by `seed`, if any."""
        seed = self._seeds[0]
        obs, info = self.env.reset(seed=seed, options=self._begin(np.ones(self.num_envs, bool)))
        self._reset_seeds()
        self.reset_infos = [row_info(info, row) for row in range(self.num_envs)]
        return obs

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions (n, action) for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Step all rows; see the class for what happens to rows that end."""
        obs, reward, terminated, truncated, info = self.env.step(self._actions)
        done = np.asarray(terminated | truncated)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if done.any():
            for row in np.flatnonzero(done).tolist():
                infos[row] = row_info(info, row)
                infos[row]["terminal_observation"] = {key: value[row].copy() for key, value in obs.items()}
                infos[row]["TimeLimit.truncated"] = bool(truncated[row] and not terminated[row])
            obs, reset = self.env.reset(options=self._begin(done))
            for row in np.flatnonzero(done).tolist():
                self.reset_infos[row] = row_info(reset, row)
        return obs, np.asarray(reward, np.float32), done, infos

    def _begin(self, rows: np.ndarray) -> dict[str, Any]:
        """Return the reset options for rows (n,) bool."""
        if self._starts is None:
            return {"reset_mask": rows}
        return {"reset_mask": rows, "start": [next(self._starts) if row else None for row in rows]}

    def close(self) -> None:
        """Close the wrapped environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the wrapped environment, repeated once per row."""
        return [getattr(self.env, attr_name) for _ in self._rows(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the wrapped environment, for all rows."""
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of the wrapped environment once, for all rows; return a list with its one result."""
        return [getattr(self.env, method_name)(*args, **kwargs)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for every row: rows are not environments of their own."""
        return [False for _ in self._rows(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return None for every row; `vispeg play` makes videos."""
        return [None] * self.num_envs

    def _rows(self, indices: None | int | Iterable[int]) -> Iterable[int]:
        return range(self.num_envs) if indices is None else [indices] if isinstance(indices, int) else indices
