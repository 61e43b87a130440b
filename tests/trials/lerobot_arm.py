"""A robot of LeRobot's kind around the simulated arm: a package `lerobot_robot_simulated` as LeRobot's plugins are."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from lerobot.robots import Robot, RobotConfig

from vispeg.trials.simulated import BEHIND, SimulatedRobot

STEP = 360.0 / 4096  # degrees of an STS3215's encoder
GAIN = 2500.0  # 1/s^2 per unit inertia, of the joints' servos; damping is critical


class Servo:
    """Position servos in the place of the controller that holds a flange: `M (kp (goal - q) - kd dq) + g`."""

    def __init__(self, control: Any, q: np.ndarray):
        self.nominal, self.limit, self.goal = control.nominal, control.limit, q.copy()

    def torque(self, q: np.ndarray, dq: np.ndarray, pos: np.ndarray, rot: np.ndarray) -> np.ndarray:
        """See PoseControl; where the flange is asked to be is not looked at."""
        mass, *_, gravity = self.nominal.operational(q)
        pull = GAIN * (self.goal - q) - 2 * np.sqrt(GAIN) * dq
        return np.clip(np.matmul(mass, pull[:, :, None])[:, :, 0] + gravity, -self.limit, self.limit)


@RobotConfig.register_subclass("simulated")
@dataclass
class SimulatedConfig(RobotConfig):
    """An arm that is simulated."""

    world: str = "nominal"
    see: str = "state"
    image_size: int = 0
    seed: int = 3
    signs: tuple[int, ...] = (1, 1, 1, 1, 1, 1, 1)
    calibrated: bool = True
    silent_after: float = 1e9  # s, from when on its bus answers nothing
    log: str = ""


class Simulated(Robot):
    """An arm with servos of positions in degrees, and a gripper from 0 to 100."""

    config_class, name = SimulatedConfig, "simulated"

    def __init__(self, config: SimulatedConfig):
        super().__init__(config)
        settings = {"image_size": config.image_size} if config.image_size else {}
        self.config, self.arm, self.gripper = config, SimulatedRobot(config.world, config.see, settings), 30.0
        self.images = {k: box.shape for k, box in self.arm.env.single_observation_space.spaces.items() if "rgb" in k}
        self.begun: float | None = None
        self.sent: list[dict[str, float]] = []

    @property
    def _motors(self) -> dict[str, type]:
        return {f"axis_{i + 1}.pos": float for i in range(7)} | {"gripper.pos": float}

    @property
    def observation_features(self) -> dict[str, Any]:
        """See Robot."""
        return self._motors | {k.partition("_")[2]: (s[1], s[2], 3) for k, s in self.images.items()}

    @property
    def action_features(self) -> dict[str, type]:
        """See Robot."""
        return self._motors

    @property
    def is_connected(self) -> bool:
        """See Robot."""
        return self.begun is not None

    @property
    def is_calibrated(self) -> bool:
        """See Robot."""
        return self.config.calibrated

    def calibrate(self) -> None:
        """Ask a person, as LeRobot's arms do."""
        input("Move it to the middle of its range and press return")

    def configure(self) -> None:
        """See Robot."""

    def connect(self, calibrate: bool = True) -> None:
        """See Robot."""
        if calibrate and not self.is_calibrated:
            self.calibrate()
        self.arm.begin(self.config.seed)
        self.servo = self.arm.sim.control = Servo(self.arm.sim.control, self.arm.measured[0])
        self.begun = time.monotonic()

    def _lived(self) -> None:
        """Its own time goes on as the host's does."""
        assert self.begun is not None
        now, period = time.monotonic(), self.arm.config.control_period
        behind = now - self.begun - self.arm.time
        if behind > BEHIND:
            self.begun += behind - BEHIND
        while self.arm.time + period <= now - self.begun:
            self.arm.tick()
        if now - self.begun > self.config.silent_after:
            raise ConnectionError("There is no status packet!")

    def get_observation(self) -> dict[str, Any]:
        """See Robot."""
        self._lived()
        q = np.degrees(self.arm.measured[0][0]) * self.config.signs
        out: dict[str, Any] = {f"axis_{i + 1}.pos": float(STEP * np.round(x / STEP)) for i, x in enumerate(q)}
        seen = self.arm.pictures([k.partition("_")[2] for k in self.images]) if self.images else {}
        return out | {"gripper.pos": self.gripper} | {k.partition("_")[2]: image for k, image in seen.items()}

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """See Robot."""
        self._lived()
        self.sent.append(dict(action))
        self.gripper = action["gripper.pos"]
        q = np.array([action[f"axis_{i + 1}.pos"] for i in range(7)]) * self.config.signs
        self.servo.goal[0] = np.radians(q)
        return action

    def disconnect(self) -> None:
        """Note how it ended."""
        if self.config.log:
            import json
            from pathlib import Path

            told = {"sent": len(self.sent), "grippers": sorted({a["gripper.pos"] for a in self.sent})}
            Path(self.config.log).write_text(json.dumps(told | {"outcome": self.arm.outcome()}))
        self.begun = None
