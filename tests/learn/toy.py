"""A reach task as small as can be, with the spaces of the real one: move a point to a target before time runs out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

SIZE, HORIZON, STEP, NEAR = 16, 12, 0.3, 0.2


class Reach(VectorEnv):
    """n points in the square; action[:2] moves them by up to 0.3; done within 0.2 of the target.

    With obs_mode `depth` the offset is seen only as a bump, 1 m above a floor at 0.3 m, in a 16 x 16 image.
    """

    metadata = {"autoreset_mode": AutoresetMode.DISABLED}

    def __init__(self, num_envs: int, obs_mode: str = "state"):
        self.num_envs, self.obs_mode, self.render_mode = num_envs, obs_mode, None
        parts: dict[str, spaces.Space] = {
            "policy": spaces.Box(-4, 4, (3 if obs_mode == "state" else 1,), np.float32),
            "privileged": spaces.Box(-4, 4, (3,), np.float32),
        }
        if obs_mode == "depth":
            parts["depth_wrist"] = spaces.Box(0, 1, (1, SIZE, SIZE), np.float32)
        self.single_observation_space = spaces.Dict(parts)
        self.single_action_space = spaces.Box(-1, 1, (3,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.offset, self.age = np.zeros((num_envs, 2)), np.zeros(num_envs, int)
        self.level = 1.0

    @property
    def longest(self) -> int:
        return HORIZON

    def set_level(self, level: float) -> None:
        self.level = level

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[dict[str, np.ndarray], dict]:
        rows = np.ones(self.num_envs, bool) if options is None else options["reset_mask"]
        if seed is not None:
            seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
            self.rngs = [np.random.default_rng(s) for s in seeds]
        for row in np.flatnonzero(rows):
            self.offset[row] = self.level * self.rngs[row].uniform(-0.9, 0.9, 2)
            self.age[row] = 0
        return self.observe(), {}

    def step(self, actions: np.ndarray) -> tuple:
        self.offset = np.clip(self.offset - STEP * np.clip(actions[:, :2], -1, 1), -1, 1)
        self.age += 1
        distance = np.linalg.norm(self.offset, axis=1)
        success, late = distance < NEAR, self.age >= HORIZON
        ends = success | late
        info = {
            "success": success,
            "category": np.where(success, "success", "timeout").astype(object),
            "peak_force": distance * 0,
            "time": self.age * 0.16,
        }
        info |= {f"_{name}": ends for name in tuple(info)}
        return self.observe(), -0.2 * distance + success, success, late & ~success, info

    def observe(self) -> dict[str, np.ndarray]:
        age = (self.age / HORIZON)[:, None]
        full = np.hstack([self.offset, age]).astype(np.float32)
        obs = {"policy": full if self.obs_mode == "state" else full[:, 2:], "privileged": full}
        if self.obs_mode == "depth":
            grid = np.linspace(-1, 1, SIZE)
            square = (grid - self.offset[:, :1])[:, None, :] ** 2 + (grid - self.offset[:, 1:])[:, :, None] ** 2
            obs["depth_wrist"] = (0.3 - 0.2 * np.exp(-square / 0.05)).astype(np.float32)[:, None]
        return obs


class Pointing:
    """A teacher that walks straight to the target, which it knows from ground truth."""

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        pass

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.clip(np.pad(obs["privileged"][:, :2] / STEP, ((0, 0), (0, 1))), -1, 1)
