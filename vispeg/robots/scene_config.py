"""The configuration of a cell: the robot, the peg, the hole and their contact."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vispeg.core.errors import UserError
from vispeg.robots import hole, user_cell, user_shapes
from vispeg.robots.declare import RobotConfig
from vispeg.robots.user_cell import PegGeometry

OTHERS = ("robot", "mesh_scale", "mesh_concavity", "peg_density")  # not dimensions of the built-in shapes


@dataclass(frozen=True, kw_only=True)
class SceneConfig(PegGeometry):
    """The configuration of a cell; see PegGeometry for the shapes.

    Attributes:
        robot: the arm, its flange and its tool.
        solref: time constant (s) and damping ratio of the peg's contacts.

    Raises:
        UserError: a value is impossible, the hole is out of reach, or a mesh file cannot be used.
    """

    robot: RobotConfig = RobotConfig()
    solref: tuple[float, float] = (0.003, 1.0)

    def __post_init__(self) -> None:
        if self.shape not in ("round", "square"):
            raise UserError("unknown peg shape", key="shape", got=self.shape, choices=("round", "square"))
        if self.clearance_mm is None and not self.hole_mesh:
            object.__setattr__(self, "clearance_mm", user_cell.CLEARANCE)
        rules = {  # key: (low, high, unit, whether low itself is allowed)
            "clearance_mm": (0.0, 20.0, "mm", False),
            "diameter": (0.005, 0.04, "m", False),
            "depth": (0.005, 0.04, "m", False),
            "chamfer": (0.0, 0.01, "m", True),
            "friction": (0.0, 3.0, "", True),
            "block": (0.0, 0.2, "m", False),
            "mesh_scale": (0.0, 1000.0, "m per unit", False),
            "mesh_concavity": (*user_shapes.CONCAVITY, "", True),
            "peg_density": (10.0, 25000.0, "kg/m3", False),
        }
        for key, (low, high, unit, closed) in rules.items():
            value = getattr(self, key)
            if value is not None and not ((low <= value if closed else low < value) and value <= high):
                expected = f"{'' if closed else 'above '}{low:g} to {high:g} {unit}".rstrip()
                raise UserError("impossible geometry", key=key, expected=expected, got=value)
        if not self.peg_mesh and not round(self.diameter * 1e3, 6).is_integer():
            raise UserError("a peg's diameter must be a whole number of mm", key="diameter", got=self.diameter)
        if not self.hole_mesh and self.apothem + self.chamfer >= self.block:
            raise UserError(
                "the hole is wider than its fixture", key="block", expected=f"> {self.apothem:g}", got=self.block
            )
        if len(self.solref) != 2 or not min(self.solref) > 0:
            expected = "a time constant (s) and a damping ratio, both above 0"
            raise UserError("impossible contact", key="solref", expected=expected, got=self.solref)
        for key, lengths in (("fixture", (3,)), ("hole_origin", (0, 3))):
            if len(getattr(self, key)) not in lengths:
                raise UserError("not a point", key=key, expected="x, y, z", got=getattr(self, key))
        x, y, z = self.fixture
        below = self.depth if self.hole_mesh else self.depth + hole.FLOOR
        near, far = self.robot.band
        if not (near <= math.hypot(x, y) <= far and below - 1e-9 <= z <= 0.4):
            raise UserError(
                "the hole is out of reach",
                key="fixture",
                expected=f"{near:g} to {far:g} m from the base's axis, {below:g} to 0.4 m high",
                got=self.fixture,
            )

        user_cell.things(self)  # raises UserError if a file cannot be used
        if self.peg_mesh or self.hole_mesh:  # last, as decomposing meshes is slow
            object.__setattr__(self, "clearance_mm", user_cell.fitted(self, self.robot.tool))

    @property
    def gap(self) -> float:
        """The clearance in diameter, m."""
        return 1e-3 * self.clearance_mm

    @property
    def apothem(self) -> float:
        """Distance of the hole's walls from its axis, m."""
        return self.diameter / 2 + self.clearance_mm / 2000
