"""A cell whose peg or hole comes from a mesh file: where it stands, what the gripper then carries, whether it fits."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.robots import tools
from vispeg.robots.model import RobotModel, load
from vispeg.robots.user_shapes import UserShape, gap, read

if TYPE_CHECKING:
    from vispeg.robots.scene import SceneConfig

INSIDE = 0.8  # share of the hole's depth at which the clearance is measured
SAME = 0.1  # share by which the clearance that is stated may miss the one that the shapes leave


def shapes(config: SceneConfig) -> tuple[UserShape | None, UserShape | None]:
    """Peg and hole block from their files, None each where the built-in one is meant."""
    c = config
    peg = read(c.peg_mesh, "peg_mesh", c.mesh_scale, c.mesh_concavity, tip=True) if c.peg_mesh else None
    block = read(c.hole_mesh, "hole_mesh", c.mesh_scale, c.mesh_concavity, c.hole_origin) if c.hole_mesh else None
    return peg, block


def placed(config: SceneConfig, block: UserShape | None) -> SceneConfig:
    """The configuration with a block from a file standing on the table."""
    if block is None:
        return config
    below = -float(block.vertices[:, 2].min())
    if below < config.depth:
        raise UserError("the hole is deeper than its mesh", key="depth", expected=f"< {below:g}", got=config.depth)
    return replace(config, fixture=(*config.fixture[:2], below))


def arm_with(config: SceneConfig, peg: str) -> RobotModel:
    """The cell's arm with its gripper holding a built-in peg, as its controller knows it."""
    return load(config.robot.model, f"{config.robot.tool}+{peg}", declared=config.robot)


def hold(config: SceneConfig, peg: UserShape) -> tuple[RobotModel, float]:
    """The arm with this peg in its gripper, as its controller knows it, and the tip's distance from the flange, m."""
    width, length = float(peg.extent[0]), float(peg.extent[2])
    if not (0.005 <= width <= 0.08 and length >= tools.FINGER_SIZE[2] + 0.02):
        expected = f"5 to 80 mm across, {1e3 * tools.FINGER_SIZE[2] + 20:g} mm long or more"
        raise UserError("no peg for this gripper", key="peg_mesh", expected=expected, got=peg.extent.round(6))
    arm, density = arm_with(config, f"peg{round(1000 * width)}"), config.peg_density
    tip, flip = tools.GRASP + length, np.array([1.0, -1.0, -1.0])  # the flange looks down on a file drawn z up
    spec = arm.spec()
    body = spec.body("peg")
    spec.delete(spec.geom("peg"))
    contact = {"contype": 0, "conaffinity": 1}
    peg.add(spec, body, "peg", lambda x: x * flip + [0, 0, tip], contact, {})
    moments, axes = np.linalg.eigh(density * peg.inertia * np.outer(flip, flip))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, axes.ravel())
    body.mass, body.ipos = density * peg.volume, peg.com * flip + [0, 0, tip]
    body.inertia, body.iquat = moments, turn
    spec.site("peg_tip").pos = (0, 0, tip)
    return replace(arm, build=spec.copy), tip


def check(spec: mujoco.MjSpec, config: SceneConfig, tip: float, peg: UserShape | None, block: UserShape | None) -> None:
    """Whether the contact shapes leave the clearance that the configuration states.

    Raises:
        UserError: the pieces of a mesh are coarser than the clearance, or the shapes leave another one.
    """
    coarse = sum(s.error for s in (peg, block) if s is not None)
    if coarse > config.clearance_mm / 2000:
        raise UserError(
            "the convex pieces of the mesh are coarser than the clearance on a side",
            key="clearance_mm",
            expected=f"> {2000 * coarse:.3g} mm, or a smaller mesh_concavity than {config.mesh_concavity:g}",
            got=config.clearance_mm,
        )
    side_gap = gap(spec.compile(), np.array([*config.fixture[:2], config.fixture[2] - INSIDE * config.depth + tip]))
    if side_gap < 0:
        raise UserError("the peg does not fit its hole", key="peg_mesh", got=f"{-1e3 * side_gap:.3g} mm too wide")
    measured = 2000 * side_gap
    if abs(measured - config.clearance_mm) > max(SAME * config.clearance_mm, 4000 * coarse):
        raise UserError(
            "peg and hole leave another clearance than stated",
            key="clearance_mm",
            expected=f"{measured:.3g}",
            got=config.clearance_mm,
        )
