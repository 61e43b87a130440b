"""What the task asks and allows; everything that is not a property of the world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from vispeg.core.errors import UserError
from vispeg.robots.scene import SceneConfig


@dataclass(frozen=True)
class TaskConfig:
    """SI units unless the name says otherwise.

    Attributes:
        clearance_mm, shape, diameter, depth, chamfer, friction, solref: the cell, see SceneConfig.
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
        dwell: policy steps that it must stay there.
        reward_scale: m, distance at which the dense reward is -1.
        cameras: that policies with images look through.
        image_size: px of the shorter side of an image, the field of view kept; 0 for the cameras' own.
    """

    clearance_mm: float = 3.0
    shape: str = "round"
    diameter: float = 0.016
    depth: float = 0.025
    chamfer: float = 0.001
    friction: float = 0.3
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
    dwell: int = 1
    reward_scale: float = 0.05
    cameras: tuple[str, ...] = ("wrist_wide", "wrist_crop")
    image_size: int = 48

    def __post_init__(self) -> None:
        ticks = self.policy_period / self.control_period
        if abs(ticks - round(ticks)) > 1e-9 or ticks < 1:
            raise UserError(
                "the policy's period is not a multiple of the controller's", key="policy_period", got=self.policy_period
            )
        for key in ("substeps", "steps", "stack"):
            if int(getattr(self, key)) < 1:
                raise UserError("too small", key=key, expected="1 or more", got=getattr(self, key))
        if not self.dof or any(d not in DOF for d in self.dof) or len(set(self.dof)) < len(self.dof):
            raise UserError("unknown directions", key="dof", got=self.dof, choices=DOF)
        low, high = self.start_height
        if not 0.002 <= low <= high <= 0.2:
            raise UserError(
                "impossible start", key="start_height", expected="0.002 to 0.2 m, low first", got=self.start_height
            )
        for key in ("offset", "force_limit", "force_abort", "reward_scale", "turn"):
            if not getattr(self, key) > 0:
                raise UserError("must be above 0", key=key, got=getattr(self, key))
        if not self.cameras or len(set(self.cameras)) < len(self.cameras):
            raise UserError("wrong cameras", key="cameras", expected="names, each once", got=self.cameras)
        if self.image_size != 0 and not 8 <= self.image_size <= 1024:
            raise UserError("impossible image", key="image_size", expected="0, or 8 to 1024 px", got=self.image_size)
        if not 0 < self.success_depth <= 1:
            raise UserError("not a share", key="success_depth", expected="above 0, at most 1", got=self.success_depth)
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
        known = {f.name: f for f in fields(cls)}
        values = {}
        for key, value in given.items():
            if key not in known:
                raise UserError("unknown key", file=file, key=f"task.{key}", got=key, choices=known)
            default = known[key].default
            if isinstance(default, tuple) and isinstance(value, (list, tuple)):
                value = tuple(value)
            kind = (int, float) if isinstance(default, (int, float)) else type(default)
            if isinstance(value, bool) or not isinstance(value, kind):
                expected = type(default).__name__
                raise UserError("wrong type", file=file, key=f"task.{key}", expected=expected, got=value)
            values[key] = value
        try:
            return cls(**values)
        except UserError as error:
            raise UserError(str(error), file=file) from error


DOF = ("x", "y", "z", "rx", "ry", "rz")
