"""Settings that every task has: timing, controller, limits, guards, start, reward and cameras."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.core.typed import checked
from vispeg.interface.observer import DOF
from vispeg.robots.declare import RobotConfig
from vispeg.task.rewards import Rewards

Weights = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Tolerance:
    """The setting that says how much room the goal leaves. A curriculum begins with a large value.

    Attributes:
        setting: field of the task's settings; a larger value is easier.
        name: its name in messages.
        unit: of the setting.
    """

    setting: str
    name: str
    unit: str = "mm"


@dataclass(frozen=True, kw_only=True)
class TaskConfig:
    """Settings of a task, in SI units unless the name says otherwise. A task adds its own fields in a subclass.

    Class attributes:
        rewards: the task's reward terms.
        tolerance: the setting that makes the task easier or harder; None where there is none.
        files: settings that hold one or several file paths. A world file states them relative to its own folder; the
            files' content enters the world's hash.

    Attributes:
        name: of the task, see vispeg.task.registry.
        robot: the arm, its flange and tool, see `vispeg.robots.declare.RobotConfig`; `robot` in a world file.
        control_period: of the controller, s.
        substeps: physics steps per control period (scripts/bench/contact_steps.py is the convergence study).
        policy_period: of the policy, s; a whole number of control periods.
        steps: policy steps per episode.
        dof: Cartesian directions that the policy moves: any of x y z rx ry rz.
        offset, turn: largest commanded offset in one policy step, m and rad.
        stiffness: of the controlled point along each translation and about each rotation, 1/s^2 (per unit of mass).
        force_limit: greatest force that the controller asks for, N.
        force_abort: contact force above which the episode ends, N.
        avoid_limits: gain that pulls joints away from their limits in the null space, 1/s^2 (per unit of inertia); 0
            for none.
        guard_velocity: share of a joint's velocity limit above which the episode ends; 0 for no guard.
        guard_limit: distance of a joint to its limit below which the episode ends, rad; 0 for no guard.
        guard_singularity: the episode ends if the Jacobian's smallest singular value is below this (m and rad count
            alike, see `vispeg.control.laws.singular`); 0 for no guard.
        start_height, start_radius: range of the tip's start relative to the nominal goal, m: lowest and highest height
            above it, greatest offset along x and y (+-).
        stack: number of time steps that an observation holds, the present one included.
        reward: one of the task's rewards by name, or a weight for each of its reward terms (vispeg.task.rewards).
        reward_scale: distance at which the reward term `distance` is 1, m.
        cameras: names of the cameras that policies with images see through.
        image_size: px of the shorter side of an image, at the same field of view; 0 for the camera's own size.
    """

    rewards: ClassVar[Rewards]
    tolerance: ClassVar[Tolerance | None] = None
    files: ClassVar[tuple[str, ...]] = ()

    name: str = ""
    robot: RobotConfig = RobotConfig()
    control_period: float = 0.005
    substeps: int = 3
    policy_period: float = 0.160
    steps: int = 50
    dof: tuple[str, ...] = ("x", "y", "z")
    offset: float = 0.010
    turn: float = 0.05
    stiffness: tuple[float, float] = (300.0, 400.0)
    force_limit: float = 25.0
    force_abort: float = 200.0
    avoid_limits: float = 0.0
    guard_velocity: float = 0.0
    guard_limit: float = 0.0
    guard_singularity: float = 0.0
    start_height: tuple[float, float] = (0.02, 0.04)
    start_radius: float = 0.02
    stack: int = 2
    reward: str | Weights = "shaped"
    reward_scale: float = 0.05
    cameras: tuple[str, ...] = ("wrist_wide", "wrist_crop")
    image_size: int = 48

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if not all(math.isfinite(x) for x in _each(value) if isinstance(x, float)):
                raise UserError("not finite", key=f.name, expected="finite numbers", got=value)
        for key in ("substeps", "steps", "stack"):
            if getattr(self, key) < 1:
                raise UserError("too small", key=key, expected="1 or more", got=getattr(self, key))
        for key in ABOVE_0:
            value = getattr(self, key)
            if not all(x > 0 for x in _each(value)):
                raise UserError("too small", key=key, expected="above 0", got=value)
        for key, most in OFF_AT_0.items():
            if not 0 <= getattr(self, key) <= most:
                raise UserError("out of bounds", key=key, expected=f"0 to {most:g}", got=getattr(self, key))
        ticks = self.policy_period / self.control_period
        if abs(ticks - round(ticks)) > 1e-9 or ticks < 1:
            expected = f"a multiple of control_period, {self.control_period:g} s"
            raise UserError(
                "not a whole number of ticks", key="policy_period", expected=expected, got=self.policy_period
            )
        if not self.dof or any(d not in DOF for d in self.dof) or len(set(self.dof)) < len(self.dof):
            raise UserError("unknown directions", key="dof", got=self.dof, choices=DOF)
        self.rewards.of(self.reward)
        low, high = self.start_height
        if not 0.002 <= low <= high <= 0.2:
            raise UserError(
                "impossible start", key="start_height", expected="0.002 to 0.2 m, low first", got=self.start_height
            )
        if not 0 <= self.start_radius <= 0.2:
            raise UserError("impossible start", key="start_radius", expected="0 to 0.2 m", got=self.start_radius)
        for key in self.files:  # absolute paths, so that the settings stay valid when they are saved elsewhere
            stated = getattr(self, key)
            placed = tuple(str(expanded(file, key=key).absolute()) for file in _each(stated) if file)
            object.__setattr__(self, key, placed if isinstance(stated, tuple) else "".join(placed))
        if not self.cameras or len(set(self.cameras)) < len(self.cameras):
            raise UserError("wrong cameras", key="cameras", expected="names, each once", got=self.cameras)
        if self.image_size != 0 and not 8 <= self.image_size <= 1024:
            raise UserError("impossible image", key="image_size", expected="0, or 8 to 1024 px", got=self.image_size)

    @property
    def ticks(self) -> int:
        """Control periods per policy step."""
        return round(self.policy_period / self.control_period)

    @property
    def turns(self) -> bool:
        """Whether the policy moves any rotation."""
        return any(d.startswith("r") for d in self.dof)

    @classmethod
    def of(cls, settings: Mapping[str, Any], file: str | None = None) -> TaskConfig:
        """Make settings from a mapping (`task:` of a world file).

        Raises:
            UserError: an unknown key, a wrong type or a value that is out of bounds; it names `file`.
        """
        at = "task." if file else ""
        values = checked(cls, settings, file, at)
        if "reward" in values:
            values["reward"] = cls.rewards.read(settings["reward"], file, f"{at}reward")
        if not isinstance(values.get("robot", cls.robot), RobotConfig):
            values["robot"] = RobotConfig.of(values["robot"], file)
        try:
            return cls(**values)
        except UserError as error:
            raise UserError(str(error), file=file) from error


def _each(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


OFF_AT_0 = {  # setting that 0 switches off -> its greatest value
    "avoid_limits": 5000.0,
    "guard_velocity": 10.0,
    "guard_limit": 1.0,
    "guard_singularity": 1.0,
}
ABOVE_0 = (
    "control_period",
    "policy_period",
    "offset",
    "turn",
    "stiffness",
    "force_limit",
    "force_abort",
    "reward_scale",
)
