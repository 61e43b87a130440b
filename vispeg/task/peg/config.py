"""Settings of the peg task beyond those of every task: the cell's shapes, and when an insertion succeeds."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

from vispeg.core.errors import UserError
from vispeg.robots.scene_config import SceneConfig
from vispeg.robots.user_cell import PegGeometry
from vispeg.task.config import TaskConfig, Tolerance
from vispeg.task.peg.rewards import REWARDS
from vispeg.task.rewards import Rewards


@dataclass(frozen=True, kw_only=True)
class PegConfig(PegGeometry, TaskConfig):
    """Settings of the peg task, in SI units unless the name says otherwise; see TaskConfig and PegGeometry for others.

    Attributes:
        solref: time constant (s) and damping ratio of the peg's contacts.
        success_depth: share of the hole's depth that the tip must reach.
        success_lateral: greatest distance of the tip from the hole's axis, m; 0 for half the peg's diameter.
        success_force: greatest contact force in the policy step, N; 0 for `force_abort`.
        dwell: number of consecutive policy steps in which these three conditions must hold.
    """

    rewards: ClassVar[Rewards] = REWARDS
    tolerance: ClassVar[Tolerance | None] = Tolerance("clearance_mm", "clearance")
    files: ClassVar[tuple[str, ...]] = ("peg_mesh", "hole_mesh", "distractor_meshes")

    name: str = "peg"
    solref: tuple[float, float] = (0.004, 1.0)
    success_depth: float = 0.8
    success_lateral: float = 0.0
    success_force: float = 0.0
    dwell: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.success_depth <= 1:
            raise UserError("not a share", key="success_depth", expected="above 0, at most 1", got=self.success_depth)
        for key, most in (("success_lateral", 0.5 * self.diameter), ("success_force", self.force_abort)):
            if not 0 <= getattr(self, key) <= most:
                expected = f"0 to {most:g}, where 0 stands for {most:g}"
                raise UserError("not a limit", key=key, expected=expected, got=getattr(self, key))
        if not 1 <= self.dwell <= self.steps:
            expected = f"1 to {self.steps}, the steps of an episode"
            raise UserError("impossible dwell", key="dwell", expected=expected, got=self.dwell)
        scene = self.scene()  # raises UserError if the geometry is impossible
        object.__setattr__(self, "clearance_mm", scene.clearance_mm)  # with its default filled in

    @property
    def within(self) -> float:
        """Greatest distance of the tip from the hole's axis at which an insertion succeeds, m."""
        return self.success_lateral or 0.5 * self.diameter

    def scene(self) -> SceneConfig:
        """Return the settings of the task's cell."""
        same = {f.name for f in fields(SceneConfig)} & {f.name for f in fields(self)}
        return SceneConfig(**{name: getattr(self, name) for name in same})
