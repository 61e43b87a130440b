"""The task as a single gymnasium environment: one row of the vector environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.world import World


class TaskEnv(gym.Env):
    """One environment of a world's task. The arguments are those of `TaskVec`, without `num_envs`."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 6.25}

    def __init__(
        self,
        world: World | RandomizedWorld | str | Path | None = None,
        obs_mode: str = "state",
        render_mode: str | None = None,
        **settings: Any,
    ):
        from vispeg.task.environments.vector import TaskVec

        self._arguments = {"world": world, "obs_mode": obs_mode, "render_mode": render_mode, **settings}
        self.vec = TaskVec(1, **self._arguments)
        self.render_mode, self.metadata = render_mode, {**self.metadata, "render_fps": self.vec.metadata["render_fps"]}
        self.cameras = self.vec.cameras
        self.observation_space, self.action_space = self.vec.single_observation_space, self.vec.single_action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Begin an episode.

        `info` holds its `seed`, the drawn values of its `world` and, with images, `cameras` (see `TaskVec.views`).
        `options["start"]` may be a `vispeg.task.start.Start`, see `TaskVec.reset`.
        """
        super().reset(seed=seed)
        start = {"start": options["start"]} if options and "start" in options else None
        obs, info = self.vec.reset(seed=seed, options=start)
        return {k: v[0] for k, v in obs.items()}, self._info({"seed": int(info["seed"][0]), "world": info["world"][0]})

    def _info(self, info: dict[str, Any]) -> dict[str, Any]:
        views = {name: {k: v[0] for k, v in view.items()} for name, view in self.vec.views().items()}
        return {**info, "cameras": views} if views else info

    def step(self, action: np.ndarray):
        """Advance by one policy step (`policy_period`, 160 ms by default).

        At the end of an episode `info` holds the entries of its record (`EpisodeResult`), and the record itself as
        `record`. With images, `info` always holds `cameras`.
        """
        reward, terminated, truncated, (record,) = self.vec.advance(np.asarray(action, float)[None])
        self.vec.look([0])
        obs = {k: v[0] for k, v in self.vec._observe().items()}
        return (
            obs,
            float(reward[0]),
            bool(terminated[0]),
            bool(truncated[0]),
            self._info({**record, "record": record} if record else {}),
        )

    def render(self):
        """Return an RGB image (H, W, 3) uint8 from a camera that overlooks the cell, or None without a render mode."""
        images = self.vec.render()
        return None if images is None else images[0]

    def close(self) -> None:
        """Free the renderers."""
        self.vec.close()

    def __getstate__(self):
        return self._arguments  # a copy is a new environment, not in the same state

    def __setstate__(self, arguments):
        self.__init__(**arguments)
