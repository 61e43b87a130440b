"""Peg and hole of a cell, built in or from mesh files: position of the fixture, load of the gripper, clearance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeVar

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.robots import hole, tools, user_shapes
from vispeg.robots.declare import RobotConfig
from vispeg.robots.model import RobotModel, load
from vispeg.robots.user_shapes import UserShape, UserThing, gap, play, read

INSIDE = 0.8  # share of the hole's depth at which the clearance is measured
CLEARANCE = 3.0  # mm, default of a cell with a built-in hole
SAME = 0.1  # relative tolerance of the stated clearance against that of the shapes
LEVELS = 24  # heights at which the outlines of peg and hole are compared
FLIP = np.array([1.0, -1.0, -1.0])  # mesh files have z up, the flange has z down
PEG_CONTACT = {"contype": 0, "conaffinity": 1}
WIDTH = 0.005, 0.08  # m, least and greatest width of a peg that the gripper holds
MOST_THINGS = 40  # greatest number of distractor meshes: every compiled cell has all of them, visible or not


@dataclass(frozen=True, kw_only=True)
class PegGeometry:
    """The peg, its hole and the fixture; lengths in m unless stated otherwise.

    Attributes:
        clearance_mm: diameter of the hole minus diameter of the peg (widths if square), mm. Default: 3, or the measured
            clearance for a hole from a file.
        shape: `round` or `square`.
        diameter: diameter of the peg (width if square).
        depth: depth of the hole.
        chamfer: width and height of the chamfer at the hole's mouth, at 45 deg.
        friction: sliding friction of the peg in the hole.
        fixture: position of the centre of the hole's mouth, base frame.
        block: half the width of the fixture.
        peg_mesh, hole_mesh: mesh files that replace the built-in shapes, see `vispeg.robots.user_shapes`. A fixture
            from a file stands on the table, at x and y of `fixture`.
        mesh_scale: m per unit of these files.
        mesh_concavity: threshold of CoACD in the decomposition of meshes that are not convex; smaller is finer.
        hole_origin: centre of the hole's mouth in its file's units; if empty, the middle of its top.
        peg_density: density of a peg from a file, kg/m^3.
        distractor_meshes: mesh files of the objects that the effect `distractors` puts on the table, instead of the
            built-in shapes; they keep their own size.
    """

    clearance_mm: float = None  # type: ignore[assignment]  # SceneConfig sets it
    shape: str = "round"
    diameter: float = 0.016
    depth: float = 0.025
    chamfer: float = 0.001
    friction: float = 0.3
    fixture: tuple[float, float, float] = (0.6, 0.0, 0.05)
    block: float = 0.05
    peg_mesh: str = ""
    hole_mesh: str = ""
    mesh_scale: float = 1.0
    mesh_concavity: float = 0.02
    hole_origin: tuple[float, ...] = ()
    peg_density: float = tools.STEEL
    distractor_meshes: tuple[str, ...] = ()


Geometry = TypeVar("Geometry", bound=PegGeometry)


def shapes(config: PegGeometry, tool: str) -> tuple[UserShape | None, UserShape | None]:
    """Load peg and hole block from their files; None for a built-in one.

    Raises:
        UserError: unusable files, or a peg that the gripper cannot hold; checked before the convex decomposition of a
            mesh, which takes seconds to minutes.
    """
    c = config
    if c.peg_mesh:
        _holdable(user_shapes.size(c.peg_mesh, "peg_mesh", c.mesh_scale), c, tool)
    if c.hole_mesh:
        user_shapes.size(c.hole_mesh, "hole_mesh", c.mesh_scale)
    peg = read(c.peg_mesh, "peg_mesh", c.mesh_scale, c.mesh_concavity, tip=True) if c.peg_mesh else None
    block = read(c.hole_mesh, "hole_mesh", c.mesh_scale, c.mesh_concavity, c.hole_origin) if c.hole_mesh else None
    return peg, block


def things(config: PegGeometry) -> tuple[UserThing, ...]:
    """Load the user's distractors for the table; empty if the built-in ones are used.

    Raises:
        UserError: files that cannot be used, or too many.
    """
    files = config.distractor_meshes
    if len(files) > MOST_THINGS:
        raise UserError("too many meshes", key="distractor_meshes", expected=f"at most {MOST_THINGS}", got=len(files))
    return tuple(user_shapes.thing(f, f"distractor_meshes[{i}]", config.mesh_scale) for i, f in enumerate(files))


def _holdable(extent: np.ndarray, config: PegGeometry, tool: str) -> None:
    """Raise UserError if the gripper cannot hold a peg of this size (3,) m or bring it to the bottom of the hole."""
    low, high = WIDTH
    at = {"file": config.peg_mesh, "key": "peg_mesh", "got": _mm(extent)}
    if not low <= extent[0] <= high:
        raise UserError(
            "the gripper cannot hold this peg", expected=f"{1e3 * low:g} to {1e3 * high:g} mm along x", **at
        )
    upper, outermost = tools.hold(tool)
    held, least = outermost - upper, outermost - upper + config.depth
    if extent[2] < least - 1e-9:
        expected = f"{1e3 * least:g} mm along z or more: the gripper covers the upper {1e3 * held:g} mm"
        expected += "; to a shorter part, add a handle on top"
        raise UserError("the gripper cannot hold this peg", expected=expected, **at)


def grasp(config: PegGeometry, tool: str) -> float:
    """Return the distance from flange to the peg's upper end, m. Raises UserError if a built-in peg is too short."""
    upper, outermost = tools.hold(tool)
    if not config.peg_mesh and tools.PEG_LENGTH < outermost - upper + config.depth - 1e-9:
        raise UserError(
            "the gripper would touch the block before the peg is in",
            file=tool,
            key="grasp",
            expected=f"at most {1e3 * (tools.PEG_LENGTH - config.depth):g} mm above its outermost point",
            got=f"{1e3 * (outermost - upper):.4g} mm",
        )
    return upper


def _mm(extent: np.ndarray) -> str:
    return " x ".join(f"{1e3 * x:.4g}" for x in extent) + " mm"


def placed(config: Geometry, block: UserShape | None) -> Geometry:
    """Return the configuration with the fixture's height such that a block from a file stands on the table."""
    return config if block is None else replace(config, fixture=(*config.fixture[:2], _below(config, block)))


def _below(config: PegGeometry, block: UserShape) -> float:
    """Return how far a block reaches below the mouth of its hole, m. Raises UserError if the hole is deeper."""
    below = -float(block.vertices[:, 2].min())
    if below < config.depth:
        raise UserError("the hole is deeper than its mesh", key="depth", expected=f"< {below:g}", got=config.depth)
    return below


def arm_with(robot: RobotConfig, peg: str) -> RobotModel:
    """Load an arm with its gripper holding a built-in peg; the controller's model includes both.

    Raises:
        UserError: no gripper, or a robot that cannot be used.
    """
    if robot.tool == "none":
        raise UserError("nothing holds the peg of this cell", key="robot.tool", expected="a gripper", got="none")
    return load(robot.model, f"{robot.tool}+{peg}", declared=robot)


def hold(config: PegGeometry, robot: RobotConfig, peg: UserShape) -> tuple[RobotModel, float]:
    """Return the arm with this peg in its gripper, and the distance of the peg's tip from the flange, m.

    The controller's model includes the peg.
    """
    width, length = float(peg.extent[0]), float(peg.extent[2])
    arm, density = arm_with(robot, f"peg{round(1000 * width)}"), config.peg_density
    tip = grasp(config, robot.tool) + length
    spec = arm.spec()
    body = spec.body("peg")
    spec.delete(spec.geom("peg"))
    peg.add(spec, body, "peg", lambda x: x * FLIP + [0, 0, tip], PEG_CONTACT, {})
    moments, axes = np.linalg.eigh(density * peg.inertia * np.outer(FLIP, FLIP))
    axes[:, 0] *= np.sign(np.linalg.det(axes))  # a rotation, not a reflection
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, axes.ravel())
    body.mass, body.ipos = density * peg.volume, peg.com * FLIP + [0, 0, tip]
    body.inertia, body.iquat = moments, turn
    spec.site("peg_tip").pos = (0, 0, tip)
    return replace(arm, build=spec.copy), tip


def fitted(config: PegGeometry, tool: str) -> float:
    """Return the clearance of a cell with a peg or hole from a file, mm: the stated one if any, else the measured one.

    Raises:
        UserError: unusable files, a peg that does not fit, convex pieces that fill more than half of the clearance, or
            a stated clearance that matches neither the meshes nor their convex pieces.
    """
    peg, block = shapes(config, tool)
    if block is not None:
        _below(config, block)
    stated = config.clearance_mm
    intended = CLEARANCE if stated is None else stated
    sizes = config.diameter, config.depth, config.shape, config.block, config.chamfer
    # one-sided clearances in m to clearances in mm
    by_pieces, by_meshes = (2000 * side for side in _one_sided(*sizes, intended, peg, block))
    if by_meshes < 0:
        raise UserError(
            "the peg does not fit its hole", key="peg_mesh", got=f"{-by_meshes / 2:.3g} mm too wide on a side"
        )
    if abs(by_meshes - by_pieces) > by_meshes / 2:
        leave = f"leave {by_pieces:.3g} mm of the clearance of {by_meshes:.3g} mm"
        finest, given = user_shapes.CONCAVITY[0], config.mesh_concavity
        finer = f"{finest:g} to less than {given:g}" if given > finest else "a simpler mesh, for this is the finest"
        what = f"the convex pieces of the mesh are too coarse: they {leave}"
        raise UserError(what, key="mesh_concavity", expected=finer, got=given)
    if block is not None and stated is None:
        return round(by_pieces, 3)
    low, high = sorted((by_pieces, by_meshes))
    if low - SAME * intended <= intended <= high + SAME * intended:
        return intended
    both = f"{by_pieces:.3g} mm by their convex pieces, {by_meshes:.3g} mm by their meshes"
    what = f"peg and hole have a clearance of {both}"
    if block is not None:
        raise UserError(what, key="clearance_mm", expected=f"{by_pieces:.3g} to {by_meshes:.3g}, or none", got=intended)
    # a built-in hole has the width of `diameter` and `clearance_mm`, so the peg's diameter differs
    width = config.diameter + 1e-3 * (intended - by_meshes)
    raise UserError(what, key="diameter", expected=f"{width:.6g}, as the peg has", got=config.diameter)


@lru_cache(maxsize=32)
def _one_sided(
    diameter: float,
    depth: float,
    shape: str,
    width: float,
    chamfer: float,
    clearance_mm: float,
    peg: UserShape | None,
    block: UserShape | None,
) -> tuple[float, float]:
    """Return the one-sided clearance at `INSIDE` of the depth, m: by the convex pieces, and by the meshes."""
    spec, at = mujoco.MjSpec(), -INSIDE * depth
    body, fixture = spec.worldbody.add_body(name="peg"), spec.worldbody.add_body(name="fixture")
    radius, apothem = diameter / 2, diameter / 2 + clearance_mm / 2000
    n = 4 if shape == "square" else hole.sides(apothem)
    if peg is not None:
        peg.add(spec, body, "peg", lambda x: x * FLIP, PEG_CONTACT, {})
    else:
        half = tools.PEG_LENGTH / 2
        kind = mujoco.mjtGeom.mjGEOM_BOX if shape == "square" else mujoco.mjtGeom.mjGEOM_CYLINDER
        size = (radius, radius, half) if shape == "square" else (radius, half, 0.0)
        body.add_geom(name="peg", type=kind, size=size, pos=(0, 0, -half), **PEG_CONTACT)
    if block is not None:
        block.add(spec, fixture, "fixture", lambda x: x, hole.CONTACT, {})
    else:
        hole.add_walls(spec, fixture, n, apothem, width, depth, chamfer)
    by_pieces = gap(spec.compile(), np.array([0.0, 0.0, at]))
    by_meshes = np.inf
    solid = np.concatenate([_ring(n, apothem), _ring(n, width)])
    for z in at * (np.arange(LEVELS) + 0.5) / LEVELS:  # in the hole's frame
        inside = _ring(n, radius) if peg is None else peg.section(z - at)
        by_meshes = min(by_meshes, play(inside, solid if block is None else block.section(z)))
    return by_pieces, float(by_meshes)


def _ring(n: int, apothem: float) -> np.ndarray:
    """Return the edges of a regular polygon (n, 2, 2), as `UserShape.section` does."""
    corners = hole.polygon(n, apothem)
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
