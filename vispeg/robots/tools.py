"""Tools at the flange: a stated inertia, or a gripper with or without a peg.

The frame of a tool is the flange frame, z away from the arm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.robots import gripper

STEEL = 7850.0  # kg/m^3
PEG_LENGTH, GRASP = 0.08, 0.105  # m: length of a peg, distance of its upper end from the flange
GRIPPER = 0.7, 0.10  # kg with fingers; m, length of the housing
FINGER_MASS, FINGER_SIZE = 0.04, (0.012, 0.020, 0.045)  # kg, m
HOUSING = (0.080, 0.050, GRIPPER[1])  # m
CELL = "meg50+peg16"  # the tool in the default cell
NAMES = ("none", "meg50", "meg50+peg40")
KEYS = ("mass_kg", "com_m", "inertia_kgm2")
BOX, CYLINDER = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER


@dataclass(frozen=True)
class Shape:
    """A homogeneous box or a cylinder along z.

    Attributes:
        name: name of the geom.
        size: full lengths x, y and z of a box, or radius and length of a cylinder, m.
        pos: centre in the flange frame, m.
        mass: kg.
        rgba: colour, 0 to 1.
    """

    name: str
    size: tuple[float, ...]
    pos: tuple[float, float, float]
    mass: float
    rgba: tuple[float, float, float, float]

    @property
    def inertia(self) -> np.ndarray:
        """Diagonal of the inertia (3,) about the shape's own centre, kg m^2."""
        if len(self.size) == 2:
            r, h = self.size
            across = self.mass * (3 * r * r + h * h) / 12
            return np.array([across, across, self.mass * r * r / 2])
        x, y, z = np.square(self.size)
        return self.mass / 12 * np.array([y + z, x + z, x + y])


def attach(spec: mujoco.MjSpec, flange: str, tool: str | Mapping[str, Any] | None) -> None:
    """Attach a tool to the flange site: a body `tool`, with a body `peg` in it if one is held.

    Args:
        spec: the arm, changed in place.
        flange: name of the flange site.
        tool: None, "none", a name of `NAMES` (any `pegNN`, NN mm in diameter), a gripper's MJCF file with or without
            `+pegNN` (`vispeg.robots.gripper`), or {mass_kg, com_m (3,) m,
            inertia_kgm2 (3,) about the centre of mass along the flange axes, name (optional)}.

    Raises:
        UserError: the name is unknown, a key is missing, or the inertia is impossible.
    """
    if tool is None or tool == "none":
        return
    if any(b.name == "tool" for b in spec.bodies):
        raise UserError("the robot already has a body named 'tool'", expected="a robot without a tool")
    site = spec.copy().compile().site(flange)  # a file may state the orientation in another way than as a quaternion
    body = spec.site(flange).parent.add_body(name="tool", pos=site.pos, quat=site.quat)
    if isinstance(tool, str):
        _add_named(spec, body, tool)
    else:
        mass, com, inertia = stated(tool)
        _set_inertial(body, mass, com, np.diag(inertia))


def stated(tool: Mapping[str, Any]) -> tuple[float, np.ndarray, np.ndarray]:
    """Check a tool mapping; return mass, kg, centre of mass (3,), m, and diagonal inertia (3,), kg m^2.

    Raises:
        UserError: an unknown or missing key, or an impossible value.
    """
    if not isinstance(tool, Mapping):
        raise UserError("not a tool", key="tool", expected="none, a name or a mapping", got=tool)
    for key in tool:
        if key not in (*KEYS, "name"):
            raise UserError("unknown key", key=f"tool.{key}", got=key, choices=(*KEYS, "name"))
    mass, com, inertia = (_numbers(tool, key, size) for key, size in zip(KEYS, (1, 3, 3), strict=True))
    if mass[0] < 0:
        raise UserError("negative mass", key="tool.mass_kg", expected="kg, zero or more", got=tool["mass_kg"])
    top = inertia.max()
    if inertia.min() < 0 or inertia.sum() - top < top * (1 - 1e-9):
        raise UserError(
            "no solid body has this inertia",
            key="tool.inertia_kgm2",
            expected="[ixx, iyy, izz] >= 0, none greater than the sum of the other two",
            got=tool["inertia_kgm2"],
        )
    return float(mass[0]), com, inertia


def _numbers(tool: Mapping[str, Any], key: str, size: int) -> np.ndarray:
    """Return the numbers (size,) of a key. Raises UserError: it is missing, or not that many finite numbers."""
    what = "a number" if size == 1 else f"{size} numbers"
    if key not in tool:
        raise UserError("missing", key=f"tool.{key}", expected=what)
    try:
        value = np.atleast_1d(np.asarray(tool[key], float))
    except (TypeError, ValueError):
        value = np.empty(0)
    if value.shape != (size,) or not np.isfinite(value).all():
        raise UserError("not a finite value", key=f"tool.{key}", expected=what, got=tool[key])
    return value


def hold(tool: str) -> tuple[float, float]:
    """Return z in the flange frame of the held part's upper end and of the gripper's outermost point, m."""
    if (from_file := gripper.of(tool)) is not None:
        return from_file[0].grasp, from_file[0].reach
    return GRASP, GRIPPER[1] + FINGER_SIZE[2]


def _add_named(spec: mujoco.MjSpec, body: Any, name: str) -> None:
    if (from_file := gripper.of(name)) is not None:
        hand, peg = from_file
        hand.add(spec, body)
        _set_inertial(body, hand.mass, hand.com, hand.inertia)
        if peg:
            _add_peg(body, int(peg[3:]) / 1000, hand.grasp)
        return
    match = re.fullmatch(r"meg50(?:\+peg(\d+))?", name)
    diameter = int(match[1]) / 1000 if match and match[1] else None
    if match is None or (diameter is not None and not 0.005 <= diameter <= 0.08):
        raise UserError("unknown tool", key="tool", expected="a peg of 5 to 80 mm, if any", got=name, choices=NAMES)
    _add_shapes(body, _gripper(0.5 * (diameter or 0.04)))
    if diameter is not None:
        _add_peg(body, diameter, GRASP)


def _add_peg(body: Any, diameter: float, grasp: float) -> None:
    """Add a body `peg` of `diameter` m whose upper end is at z = `grasp` m."""
    peg = body.add_body(name="peg")
    mass = STEEL * math.pi * diameter**2 / 4 * PEG_LENGTH
    steel = (0.62, 0.64, 0.67, 1.0)
    _add_shapes(peg, [Shape("peg", (diameter / 2, PEG_LENGTH), (0, 0, grasp + PEG_LENGTH / 2), mass, steel)])
    peg.add_site(name="peg_tip", pos=(0, 0, grasp + PEG_LENGTH), group=4)


def _gripper(grip: float) -> list[Shape]:
    """Return the housing and two fingers that are closed on a part of radius `grip` (m)."""
    dark = (0.18, 0.19, 0.21, 1.0)
    mass, length = GRIPPER
    x, z = grip + FINGER_SIZE[0] / 2, length + FINGER_SIZE[2] / 2
    return [
        Shape("gripper", HOUSING, (0, 0, length / 2), mass - 2 * FINGER_MASS, (0.55, 0.57, 0.60, 1.0)),
        Shape("finger_left", FINGER_SIZE, (x, 0, z), FINGER_MASS, dark),
        Shape("finger_right", FINGER_SIZE, (-x, 0, z), FINGER_MASS, dark),
    ]


def _add_shapes(body: Any, shapes: list[Shape]) -> None:
    """Add these shapes to a body as geoms, with their combined inertia; they collide with the scene, not the arm."""
    mass = sum(s.mass for s in shapes)
    com = np.sum([s.mass * np.array(s.pos) for s in shapes], axis=0) / mass
    inertia = np.zeros((3, 3))
    for s in shapes:
        r = np.array(s.pos) - com
        inertia += np.diag(s.inertia) + s.mass * (r @ r * np.eye(3) - np.outer(r, r))  # parallel axes
        box = len(s.size) == 3
        size = [c / 2 for c in s.size] if box else [s.size[0], s.size[1] / 2, 0.0]
        body.add_geom(
            name=s.name,
            type=BOX if box else CYLINDER,
            size=size,
            pos=s.pos,
            rgba=s.rgba,
            contype=0,
            conaffinity=1,
            mass=0.0,
        )
    _set_inertial(body, mass, com, inertia)


def _set_inertial(body: Any, mass: float, com: np.ndarray, inertia: np.ndarray) -> None:
    """Set a body's mass, kg, centre of mass (3,), m, and inertia (3, 3) about it, kg m^2."""
    body.mass, body.ipos, body.explicitinertial = mass, com, True
    off = [inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    if np.abs(off).max() > 1e-12 * np.trace(inertia):
        body.fullinertia = [*np.diag(inertia), *off]
    else:
        body.inertia = np.diag(inertia)
