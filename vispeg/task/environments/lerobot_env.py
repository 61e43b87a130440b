"""The task as LeRobot's evaluations ask for an environment: pictures (H, W, 3), readings, and whether it succeeded."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from vispeg.render.image_kinds import RGB
from vispeg.task.environments.env import TaskEnv
from vispeg.task.registry import task_of
from vispeg.task.terms import MEASURED

PIXELS, STATE = "pixels", "agent_pos"  # as LeRobot names them


class LeRobotEnv(gym.Env):
    """A world's task as LeRobot's evaluations ask for one.

    Args:
        world: a built-in world's name or a world file.
        cameras: that are shown; empty: those of the world's task.
        image_size: pixels of a picture's shorter side; 0: what the world's task says.
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
        """Begin the episode of a seed, the one that `vispeg evaluate` plays for it."""
        super().reset(seed=seed)
        obs, _ = self.env.reset(seed=seed, options=options)
        return self._told(obs), {"is_success": False}

    def step(self, action: np.ndarray):
        """Play one policy step."""
        obs, reward, terminated, truncated, info = self.env.step(np.clip(action, -1, 1))
        return self._told(obs), reward, terminated, truncated, {"is_success": bool(info.get("success", False))}

    def _told(self, obs: dict[str, np.ndarray]) -> dict[str, Any]:
        images = {n: np.ascontiguousarray(np.moveaxis(obs[f"{RGB.name}_{n}"], 0, -1)) for n in self._names}
        return {STATE: obs[MEASURED], PIXELS: images}

    def render(self):
        """Give an RGB image (H, W, 3) uint8 from outside."""
        return self.env.render()

    def close(self) -> None:
        """Free the renderers."""
        self.env.close()
