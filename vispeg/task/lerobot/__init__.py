"""Register a world's task as an environment of LeRobot, for `lerobot-eval` and `lerobot-train`.

These commands import this package if `--env.discover_packages_path=vispeg.task.lerobot` is given. Then
`--env.type=vispeg` selects the environment, and `--env.FIELD` sets a field of `VispegEnv`, such as `--env.world=VNP`.
Policies get observations under the keys of rendered datasets: `observation.state` and `observation.images.CAMERA`
(docs/datasets.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig

from vispeg.task.environments.lerobot_env import PIXELS, STATE, LeRobotEnv

ID = "vispeg/LeRobot-v0"
ACTION = "action"

gym.register(ID, f"{LeRobotEnv.__module__}:{LeRobotEnv.__name__}")


@EnvConfig.register_subclass("vispeg")
@dataclass
class VispegEnv(EnvConfig):
    """Options of the environment, and its features in LeRobot's terms.

    Attributes:
        task, fps: as in LeRobot's EnvConfig.
        world, cameras, image_size: as for LeRobotEnv.
        features: key in the environment's observation, or ACTION -> kind and shape; set from the world.
        features_map: key of `features` -> key for policies; set likewise.
    """

    task: str | None = "vispeg"
    fps: int = 6
    world: str = "nominal"
    cameras: list[str] = field(default_factory=list)
    image_size: int = 0
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(default_factory=dict)

    def __post_init__(self):
        env = LeRobotEnv(self.world, tuple(self.cameras), self.image_size)
        seen: Any = env.observation_space  # STATE and PIXELS, whose spaces are those of the cameras by name
        self.features = {
            ACTION: PolicyFeature(FeatureType.ACTION, env.action_space.shape),
            STATE: PolicyFeature(FeatureType.STATE, seen[STATE].shape),
        }
        self.features_map = {ACTION: ACTION, STATE: "observation.state"}
        for name, space in seen[PIXELS].spaces.items():
            self.features[f"{PIXELS}/{name}"] = PolicyFeature(FeatureType.VISUAL, space.shape)
            self.features_map[f"{PIXELS}/{name}"] = f"observation.images.{name}"
        env.close()

    @property
    def gym_id(self) -> str:
        """Id of the environment in gymnasium's registry."""
        return ID

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Arguments with which gymnasium makes a LeRobotEnv."""
        sizes = {"cameras": tuple(self.cameras), "image_size": self.image_size}
        return {"world": self.world, **sizes, "render_mode": "rgb_array"}
