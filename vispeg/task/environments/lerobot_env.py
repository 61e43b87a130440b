"""The task as an environment for LeRobot's evaluations: images (H, W, 3), readings in SI units, and `is_success`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from vispeg.interface.terms import MEASURED
from vispeg.render.image_kinds import RGB
from vispeg.task.environments.env import TaskEnv
from vispeg.task.registry import task_of

PIXELS, STATE = "pixels", "agent_pos"  # as LeRobot names them


class LeRobotEnv(gym.Env):
    """A world's task as an environment for LeRobot's evaluations.

    Args:
        world: a built-in world's name or a world file.
        cameras: names of the cameras in observations; if empty, those of the world's task.
        image_size: pixels of an image's shorter side; 0 for the value of the world's task.
        render_mode: None or `rgb_array`.
    """

    metadata = TaskEnv.metadata

    def __init__(
        self,
        world: str = "nominal",
        cameras: tuple[str, ...] = (),
        image_size: int = 0,
        render_mode: str | None = None,
    ):
        chosen: dict[str, Any] = {"cameras": tuple(cameras)} if cameras else {}
        chosen |= {"image_size": image_size} if image_size else {}
        self.env = TaskEnv(world, "rgb", render_mode, measured=True, **chosen)
        self.metadata = self.env.metadata
        self.render_mode, self.action_space = render_mode, self.env.action_space
        config = self.env.vec.config
        self.task = self.task_description = task_of(config).title
        self._max_episode_steps = config.steps  # LeRobot's rollout reads it
        self._names = [c.name for c in self.env.cameras]
        spaces: Any = self.env.observation_space
        sizes = {n: spaces[f"{RGB.name}_{n}"].shape[1:] for n in self._names}
        images: Any = {n: gym.spaces.Box(0, 255, (*size, 3), np.uint8) for n, size in sizes.items()}
        self.observation_space = gym.spaces.Dict({STATE: spaces[MEASURED], PIXELS: gym.spaces.Dict(images)})

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Begin the episode of a seed: the same one that `vispeg evaluate` plays for that seed."""
        super().reset(seed=seed)
        obs, _ = self.env.reset(seed=seed, options=options)
        return self._converted(obs), {"is_success": False}

    def step(self, action: np.ndarray):
        """Advance by one policy step; actions outside +-1 are clipped."""
        obs, reward, terminated, truncated, info = self.env.step(np.clip(action, -1, 1))
        return self._converted(obs), reward, terminated, truncated, {"is_success": bool(info.get("success", False))}

    def _converted(self, obs: dict[str, np.ndarray]) -> dict[str, Any]:
        images = {n: np.ascontiguousarray(np.moveaxis(obs[f"{RGB.name}_{n}"], 0, -1)) for n in self._names}
        return {STATE: obs[MEASURED], PIXELS: images}

    def render(self):
        """Return an RGB image (H, W, 3) uint8 from a camera that overlooks the cell, or None without a render mode."""
        return self.env.render()

    def close(self) -> None:
        """Free the renderers."""
        self.env.close()
