"""What the task asks and allows; everything that is not a property of the world."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, get_args, get_type_hints

from vispeg.core.errors import UserError
from vispeg.robots.scene import SceneConfig
from vispeg.task.peg.reward import REWARDS


@dataclass(frozen=True)
class TaskConfig:
    """SI units unless the name says otherwise.

    Attributes:
        clearance_mm, shape, diameter, depth, chamfer, friction, fixture, block, solref: the cell, see SceneConfig.
        peg_mesh, hole_mesh, mesh_scale, mesh_concavity, hole_origin, peg_density: your own shapes, see SceneConfig.
        control_period: of the controller, s.
        substeps: physics steps a control period (docs/task.md holds the convergence study).
        policy_period: of the policy, s; a whole number of control periods.
        steps: policy steps an episode.
        dof: Cartesian directions that the policy moves: any of x y z rx ry rz.
        offset, turn: largest commanded offset in one policy step, m and rad.
        stiffness: of the controlled point along each translation and about each rotation, 1/s^2 per unit mass.
        force_limit: greatest force that the controller asks for, N.
        force_abort: contact force that ends the episode, N.
        start_height, start_radius: of the peg's tip above the nominal hole, m: range of heights, lateral range (+-).
        stack: observations and actions that the policy sees, the present one included.
        success_depth: share of the hole's depth that the tip must reach.
        success_lateral: greatest distance of the tip from the hole's axis there, m; 0 for half the peg's diameter.
        success_force: greatest contact force there, N; 0 for `force_abort`.
        dwell: policy steps in a row that all three must hold.
        reward: `shaped` or `paper`, see vispeg.task.peg.reward.
        reward_scale: m, d0 of the shaped reward.
        cameras: that policies with images look through.
        image_size: px of the shorter side of an image, the field of view kept; 0 for the cameras' own.
    """

    clearance_mm: float = 3.0
    shape: str = "round"
    diameter: float = 0.016
    depth: float = 0.025
    chamfer: float = 0.001
    friction: float = 0.3
    fixture: tuple[float, float, float] = SceneConfig.fixture
    block: float = SceneConfig.block
    solref: tuple[float, float] = (0.004, 1.0)
    peg_mesh: str = ""
    hole_mesh: str = ""
    mesh_scale: float = 1.0
    mesh_concavity: float = 0.02
    hole_origin: tuple[float, ...] = ()
    peg_density: float = 7850.0
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
    start_height: tuple[float, float] = (0.02, 0.04)
    start_radius: float = 0.02
    stack: int = 2
    success_depth: float = 0.8
    success_lateral: float = 0.0
    success_force: float = 0.0
    dwell: int = 1
    reward: str = "shaped"
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
        ticks = self.policy_period / self.control_period
        if abs(ticks - round(ticks)) > 1e-9 or ticks < 1:
            expected = f"a multiple of control_period, {self.control_period:g} s"
            raise UserError(
                "not a whole number of ticks", key="policy_period", expected=expected, got=self.policy_period
            )
        if not self.dof or any(d not in DOF for d in self.dof) or len(set(self.dof)) < len(self.dof):
            raise UserError("unknown directions", key="dof", got=self.dof, choices=DOF)
        if self.reward not in REWARDS:
            raise UserError("unknown reward", key="reward", got=self.reward, choices=REWARDS)
        low, high = self.start_height
        if not 0.002 <= low <= high <= 0.2:
            raise UserError(
                "impossible start", key="start_height", expected="0.002 to 0.2 m, low first", got=self.start_height
            )
        if not 0 <= self.start_radius <= 0.2:
            raise UserError("impossible start", key="start_radius", expected="0 to 0.2 m", got=self.start_radius)
        if not self.cameras or len(set(self.cameras)) < len(self.cameras):
            raise UserError("wrong cameras", key="cameras", expected="names, each once", got=self.cameras)
        if self.image_size != 0 and not 8 <= self.image_size <= 1024:
            raise UserError("impossible image", key="image_size", expected="0, or 8 to 1024 px", got=self.image_size)
        if not 0 < self.success_depth <= 1:
            raise UserError("not a share", key="success_depth", expected="above 0, at most 1", got=self.success_depth)
        for key, most in (("success_lateral", 0.5 * self.diameter), ("success_force", self.force_abort)):
            if not 0 <= getattr(self, key) <= most:
                expected = f"0 to {most:g}, where 0 stands for {most:g}"
                raise UserError("not a limit", key=key, expected=expected, got=getattr(self, key))
        if not 1 <= self.dwell <= self.steps:
            expected = f"1 to {self.steps}, the steps of an episode"
            raise UserError("impossible dwell", key="dwell", expected=expected, got=self.dwell)
        self.scene()  # raises where the geometry cannot be

    @property
    def ticks(self) -> int:
        """Control periods a policy step."""
        return round(self.policy_period / self.control_period)

    def scene(self) -> SceneConfig:
        """The cell that this task needs."""
        same = {f.name for f in fields(SceneConfig)} & {f.name for f in fields(self)}
        return SceneConfig(**{name: getattr(self, name) for name in same})

    @classmethod
    def of(cls, given: Mapping[str, Any], file: str | None = None) -> TaskConfig:
        """From a mapping (a world file's `task:`), with an error for unknown keys and wrong types."""
        hints, values, at = get_type_hints(cls), {}, "task." if file else ""
        for key, value in given.items():
            if key not in hints:
                raise UserError("unknown key", file=file, key=f"{at}{key}", got=key, choices=hints)
            values[key] = tuple(value) if isinstance(value, list) else value
            if not _fits(values[key], hints[key]):
                raise UserError("wrong type", file=file, key=f"{at}{key}", expected=_said(hints[key]), got=value)
        try:
            return cls(**values)
        except UserError as error:
            raise UserError(str(error), file=file) from error


def _each(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value is what a field's annotation says; an int will do for a float, a bool for nothing."""
    if parts := get_args(hint):
        length = isinstance(value, tuple) and (... in parts or len(value) == len(parts))
        return length and all(_fits(x, parts[0]) for x in value)
    return isinstance(value, (int, float) if hint is float else hint) and not isinstance(value, bool)


def _said(hint: Any) -> str:
    """An annotation in words."""
    kind, *others = get_args(hint) or (hint,)
    one = {int: "whole number", float: "number", str: "text"}[kind]
    if not others:
        return f"a {one}"
    return f"a list of {one}s" if ... in others else f"a list of {1 + len(others)} {one}s"


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
DOF = ("x", "y", "z", "rx", "ry", "rz")
