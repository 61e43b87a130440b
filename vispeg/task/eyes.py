"""What the cameras of every row see; nothing in the modes without images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np

MODES = ("state", "proprio", "depth", "rgb", "rgbd")
FAR = 4.0  # m, greatest depth that is told apart


def image_spaces(obs_mode: str, cameras: Sequence[Any]) -> dict[str, gym.Space]:
    """Spaces `depth_<camera>` (1, H, W) float32 m, 0 = no reading, and `rgb_<camera>` (3, H, W) uint8."""
    out: dict[str, gym.Space] = {}
    for c in cameras:
        if obs_mode in ("depth", "rgbd"):
            out[f"depth_{c.name}"] = gym.spaces.Box(0.0, FAR, (1, c.height, c.width), np.float32)
        if obs_mode in ("rgb", "rgbd"):
            out[f"rgb_{c.name}"] = gym.spaces.Box(0, 255, (3, c.height, c.width), np.uint8)
    return out


class Eyes:
    """Renders the rows of a simulation; see `see`."""

    def __init__(self, sim: Any, obs_mode: str, file: Any, backend: str):
        self.sim, self.obs_mode, self.backend = sim, obs_mode, backend
        self.cameras: tuple[Any, ...] = ()

    def begin(self, rows: np.ndarray) -> None:
        """New episodes: new looks."""

    def see(self) -> dict[str, np.ndarray]:
        """The images of every row, as `image_spaces` states."""
        return {}

    def picture(self, row: int) -> np.ndarray:
        """An image of a row from outside, (H, W, 3) uint8."""
        raise NotImplementedError

    def close(self) -> None:
        """Frees the renderers."""
