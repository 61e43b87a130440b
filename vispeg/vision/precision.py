"""Compute how well frames determine a camera's errors, from its predicted borders, with all errors unknown at once.

Borders move by the projection alone, so their derivatives by each parameter of each effect come from finite
differences without drawing. All parameters of a camera are free, together with the places of things that stand in the
scene. The arm does not come back exactly to a pose: an error of the flange, independent in each view, moves what it
carries relative to the rest. For motions that determine these errors see `vispeg.identify.motions.look_motion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.vision.borders import Borders
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World


class Number(NamedTuple):
    """A number that describes an error of a camera: a parameter of an effect.

    Attributes:
        effect, parameter: the effect and its parameter.
        step: of the finite difference, in the parameter's own unit.
        enough: sigma below which it is determined, in the same unit.
        unit: unit in which its precision is reported.
        factor: from its own unit to that one.
    """

    effect: str
    parameter: str
    step: float
    enough: float
    unit: str
    factor: float


DELAY_STEP = 1e-3  # s
PLACED = (
    Number("focal_error", "fx", 1e-4, 2e-3, "%", 100.0),
    Number("focal_error", "fy", 1e-4, 2e-3, "%", 100.0),
    Number("principal_point_error", "x", 1e-2, 0.5, "px", 1.0),
    Number("principal_point_error", "y", 1e-2, 0.5, "px", 1.0),
    Number("lens_distortion", "k1", 1e-4, 5e-3, "1", 1.0),
    *(Number("camera_offset", axis, 1e-5, 5e-4, "mm", 1e3) for axis in "xyz"),
    *(Number("camera_offset", axis, 1e-5, 1.75e-3, "deg", 57.29578) for axis in ("rx", "ry", "rz")),
)
TIMED = (  # in the order of `_of_time`
    Number("camera_delay", "delay", DELAY_STEP, 2e-3, "ms", 1e3),
    Number("rolling_shutter", "readout", DELAY_STEP, 4e-3, "ms", 1e3),
)
STEP = 1e-5  # m, of the finite difference that moves an object of the scene
ROBOT_M, ROBOT_RAD = 1e-4, 3.5e-4  # m, rad, sigma with which an arm comes back to a pose
BORDER = 1.5  # px, sigma of a border point: 0.3 px, times the root of 25 neighbours that share their error
# Sigma of what is known of each parameter beforehand, in its own unit (1, px, m, rad, s), by the unit of its report:
# wider than any camera's errors, it only keeps inverses finite
PRIOR = {"%": 0.2, "px": 30.0, "1": 0.2, "mm": 0.1, "deg": 0.2, "ms": 0.5}


@dataclass(frozen=True)
class Precision:
    """How well one parameter of an effect would be known.

    Attributes:
        effect, parameter: the effect and its parameter.
        sigma: its standard deviation, in `unit`.
        determined: whether that is below `Number.enough`.
    """

    effect: str
    parameter: str
    sigma: float
    unit: str
    determined: bool


@dataclass(frozen=True, eq=False)
class View:
    """One frame: its n border points, joint angles (nj,) rad and joint velocities (nj,) rad/s."""

    borders: Borders
    q: np.ndarray
    dq: np.ndarray


def precisions(geometry: Geometry, camera: str, views: Sequence[View]) -> list[Precision]:
    """Return how well these views of a camera determine each number of its errors.

    Args:
        geometry: of the cell; it is moved, and left in the nominal world.
        camera: its name.
        views: with borders as predicted in the nominal world.
    """
    (height,) = [c.height for c in geometry.cameras if c.name == camera]
    columns: list[list[np.ndarray]] = [[] for _ in views]  # of each view: a derivative (n,) for each unknown

    def differentiate(step: float) -> None:
        for view, into in zip(views, columns, strict=True):
            geometry.at(view.q)
            into.append(view.borders.moved(geometry, camera) / step)

    for n in PLACED:
        geometry.place(World(effects=(EffectInstance.of(n.effect, camera, **{n.parameter: n.step}),)))
        differentiate(n.step)
    geometry.place(World())
    for view, into in zip(views, columns, strict=True):
        geometry.at(view.q - DELAY_STEP * view.dq)  # a delayed picture shows an earlier posture
        into += _of_time(view.borders.moved(geometry, camera) / DELAY_STEP, view.borders, height)
    shifts = [(body, axis) for body in _standing(geometry) for axis in range(3)]
    for body, axis in shifts:
        geometry.model.body_pos[body, axis] += STEP
        differentiate(STEP)
        geometry.model.body_pos[body, axis] -= STEP

    numbers = [*PLACED, *TIMED]
    prior = [PRIOR[n.unit] for n in numbers] + [RULES.thing_known[0]] * len(shifts)
    information = np.diag(1 / np.square(prior))
    for view, into in zip(views, columns, strict=True):
        offset = np.column_stack(
            [x for n, x in zip(PLACED, into[: len(PLACED)], strict=True) if n.effect == "camera_offset"]
        )
        information += _of_view(np.column_stack(into), _robot(offset, view, geometry, camera))
    sigma = np.sqrt(np.diag(np.linalg.inv(information)))[: len(numbers)]
    return [
        Precision(n.effect, n.parameter, float(s * n.factor), n.unit, bool(s < n.enough))
        for n, s in zip(numbers, sigma, strict=True)
    ]


def _standing(geometry: Geometry) -> list[int]:
    """Return the body ids of the scene's objects that do not move with the arm."""
    bodies = [geometry.model.body(name).id for name in geometry.scene.things]
    return [body for body in bodies if geometry.model.body_weldid[body] == 0]


def _of_time(late: np.ndarray, borders: Borders, height: int) -> list[np.ndarray]:
    """Return the speeds (n,) px/s of borders along their normals per second of delay, and per second of read-out time.

    Args:
        late: (n,) px/s, per second of delay.
        borders: the borders; rows below the middle are read later, those above earlier.
        height: of the image, px.
    """
    return [late, late * (0.5 - borders.pixel[:, 1] / (height - 1))]


def _robot(offset: np.ndarray, view: View, geometry: Geometry, camera: str) -> np.ndarray:
    """Return the displacement (n, 6) px of borders for one sigma of each of the flange's errors in position and angle.

    If the flange carries either the camera or the border, but not both, its errors displace the border as an offset of
    the camera does, except for a sign, which does not matter, and for the lever arm of the angles, which is neglected.
    Otherwise camera and border do not move relative to each other.

    Args:
        offset: (n, 6) px per m and px per rad, displacement for an offset of the camera.
        view: the view.
        geometry: of the cell.
        camera: its name.
    """
    model = geometry.model
    flange = model.body_weldid[model.site_bodyid[model.site(geometry.scene.flange).id]]
    things = [model.body(name).id for name in geometry.scene.things]
    carried = np.isin(np.arange(model.nbody), [b for b in things if model.body_weldid[b] != 0])
    carried |= model.body_weldid == flange
    moves = carried[view.borders.body] != carried[geometry.carrier(camera)]
    return np.where(moves[:, None], offset, 0.0) * np.repeat([ROBOT_M, ROBOT_RAD], 3)


def _of_view(J: np.ndarray, robot: np.ndarray) -> np.ndarray:
    """Return the information J' C^-1 J of one view, C = BORDER^2 I + robot robot' (inverted by Woodbury's identity).

    Args:
        J: (n, k) px per unit, derivatives of the borders by the k unknowns.
        robot: (n, 6) px, see `_robot`.
    """
    J = np.nan_to_num(J)
    robot = np.nan_to_num(robot)
    small = np.eye(robot.shape[1]) + robot.T @ robot / BORDER**2
    cross = robot.T @ J / BORDER**2
    return J.T @ J / BORDER**2 - cross.T @ np.linalg.solve(small, cross)
