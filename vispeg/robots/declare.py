"""A user's declaration of the robot in a cell: its model, flange, tool, limits and home posture."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.typed import checked

BANDS = {"iiwa14": (0.35, 0.75)}  # m, least and greatest distance of a hole from the base's axis
# mm, ISO 9283, from the data sheets of KUKA LBR iiwa, Franka Emika Panda and Research 3, Universal Robots e-Series
REPEATABILITY = {"iiwa14": 0.15, "iiwa7": 0.1, "panda": 0.1, "fr3": 0.1, "ur5e": 0.03, "ur10e": 0.05}
ANYWHERE = (0.1, 2.0)  # m; inverse kinematics finds out what the arm can reach


@dataclass(frozen=True)
class RobotConfig:
    """A robot in a cell. SI units, radians; empty fields are taken from the robot's own file.

    Attributes:
        model: a robot's name, or a path to an MJCF or URDF, see `vispeg.robots.model.load`.
        tool: the gripper at the flange, see `vispeg.robots.tools`: a name, or the path of an MJCF.
        without: bodies of the file to remove with everything attached to them, such as a hand.
        flange: site or body of the file that the flange is fixed to; if empty, the one with the most likely name.
        flange_pos, flange_quat: pose of the flange in that frame, m and w x y z. The flange's z axis points away from
            the arm.
        home: (nj,) the posture from which inverse kinematics starts; solved for the cell if empty.
        torque_limit, velocity_limit: (nj,) N m and rad/s, replacing those of the file.
        damping: (nj,) N m s/rad, replacing that of the file: some files state the damping of a position servo, which a
            torque-driven arm does not have.
        repeatability: pose repeatability (ISO 9283), m, replacing that of the data sheet; 0: not stated.
    """

    model: str = "iiwa14"
    tool: str = "meg50"
    without: tuple[str, ...] = ()
    flange: str = ""
    flange_pos: tuple[float, float, float] = (0.0, 0.0, 0.0)
    flange_quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    home: tuple[float, ...] = ()
    torque_limit: tuple[float, ...] = ()
    velocity_limit: tuple[float, ...] = ()
    damping: tuple[float, ...] = ()
    repeatability: float = 0.0

    def __post_init__(self) -> None:
        rules: dict[str, tuple[Callable[[float], bool], str]] = {
            "flange_pos": (math.isfinite, "finite numbers, m"),
            "flange_quat": (math.isfinite, "finite numbers, w x y z"),
            "home": (math.isfinite, "finite numbers, rad"),
            "torque_limit": (lambda x: x > 0, "above 0 N m"),
            "velocity_limit": (lambda x: x > 0, "above 0 rad/s"),
            "damping": (lambda x: 0 <= x < math.inf, "0 or more N m s/rad"),
        }
        for key, (valid, expected) in rules.items():
            if not all(valid(x) for x in getattr(self, key)):
                raise UserError("impossible robot", key=f"robot.{key}", expected=expected, got=getattr(self, key))
        if not 0 <= self.repeatability < math.inf:
            key, got = "robot.repeatability", self.repeatability
            raise UserError("impossible robot", key=key, expected="0 or more, m", got=got)
        if math.hypot(*self.flange_quat) < 1e-6:
            raise UserError("not a rotation", key="robot.flange_quat", expected="w x y z", got=self.flange_quat)
        if not self.flange and (any(self.flange_pos) or self.flange_quat != RobotConfig.flange_quat):
            raise UserError("a pose without a frame", key="robot.flange", expected="the site or body that it is in")

    @classmethod
    def of(cls, entry: Any, file: str | None = None) -> RobotConfig:
        """Read the entry `robot` of a world file: a name or path, or a mapping of these fields.

        Raises:
            UserError: the entry is neither, or has an unknown key, a wrong type or an impossible value.
        """
        if isinstance(entry, str):
            entry = {"model": entry}
        if not isinstance(entry, Mapping):
            raise UserError("wrong robot", file=file, key="robot", expected="a name, a path or a mapping", got=entry)
        values = checked(cls, entry, file, "robot.")
        try:
            return cls(**values)
        except UserError as error:
            raise UserError(str(error), file=file) from error

    @property
    def band(self) -> tuple[float, float]:
        """Least and greatest distance of a hole from the base's axis, m."""
        return BANDS.get(self.model, ANYWHERE)

    @property
    def repeats_mm(self) -> float | None:
        """Pose repeatability, mm: as stated, else from the data sheet; None if neither is known."""
        return 1e3 * self.repeatability or REPEATABILITY.get(self.model)

    def check(self, nj: int, label: str) -> None:
        """Raise UserError for a list that does not have one number per joint (`nj`); `label` names the robot."""
        for f in fields(self):
            value = getattr(self, f.name)  # the types are text, as `annotations` is imported
            if f.type == "tuple[float, ...]" and value and len(value) != nj:
                raise UserError("not one number per joint", file=label, key=f"robot.{f.name}", expected=nj, got=value)
