"""The pose of a camera, with 95 % intervals, from poses alone: those of the flange, and of a tag in the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.core.errors import UserError
from vispeg.render.calibration.hand_eye import HandEye, Mount, solve_poses
from vispeg.render.calibration.intervals import half_widths, leave_out
from vispeg.render.calibration.rigid import difference

OTHER_WAY = 5.0  # if the other mount gives so many times smaller errors of the robot, the stated mount is wrong
MIN_POSES = 5  # four fix the answer, and leaving one out must leave four


@dataclass(frozen=True)
class Placed:
    """The pose of a camera.

    Attributes:
        found: the solution; its `pixels` are empty.
        half: half widths of the 95 % intervals of the camera's pose, (6,): m along the mount's axes, rad about the
            camera's.
    """

    found: HandEye
    half: np.ndarray


def place(tags: np.ndarray, flange: np.ndarray, mount: Mount) -> Placed:
    """Find the camera's pose on the flange (tag at rest) or on the base (tag on the flange).

    Args:
        tags: camera_T_tag, (n, 4, 4) m.
        flange: base_T_flange, (n, 4, 4) m.
        mount: what the camera is fixed to.

    Raises:
        UserError: there are too few poses, all turns are about one axis, or the poses fit the other mount far better.
    """
    if len(tags) < MIN_POSES:
        raise UserError("too few poses", expected=f"{MIN_POSES} or more", got=len(tags))
    no_noise = np.zeros((len(tags), 6, 6))
    found = solve_poses(tags, no_noise, flange, mount)
    other: Mount = "base" if mount == "flange" else "flange"
    try:
        swapped = solve_poses(tags, no_noise, flange, other)
    except UserError:
        swapped = None
    if swapped is not None and OTHER_WAY * swapped.robot[0] < found.robot[0]:
        what = "the poses fit the other way round: --mount is wrong, or they are the base's in the flange's frame"
        got = f"{1e3 * found.robot[0]:.3g} mm off, {1e3 * swapped.robot[0]:.3g} mm the other way"
        raise UserError(what, expected="base_T_flange and camera_T_tag", got=got)

    def shift(rows: np.ndarray) -> np.ndarray:
        return difference(
            solve_poses(tags[rows], no_noise[rows], flange[rows], mount, start=found).camera, found.camera
        )

    half = np.maximum(half_widths(leave_out(len(tags), shift)), 1.96 * found.std)
    return Placed(found, half)
