"""Compute how well frames determine a camera's errors, from its predicted borders, with all errors unknown at once.

Borders move by the projection alone, so their derivatives by each parameter of each effect come from finite
differences without drawing. All parameters of a camera are free, together with the places of things that stand in the
scene. The arm does not come back exactly to a pose: an error of the flange, independent in each view, moves what it
carries relative to the rest. For motions that determine these errors see `vispeg.identify.motions.look_motion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.vision.borders import Borders
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

# effect -> parameter: step of the difference, sigma below which it is determined (both in the parameter's unit), unit
# in which it is reported, factor to that unit
NUMBERS: dict[str, dict[str, tuple[float, float, str, float]]] = {
    "focal_error": {"fx": (1e-4, 2e-3, "%", 100.0), "fy": (1e-4, 2e-3, "%", 100.0)},
    "principal_point_error": {"x": (1e-2, 0.5, "px", 1.0), "y": (1e-2, 0.5, "px", 1.0)},
    "lens_distortion": {"k1": (1e-4, 5e-3, "1", 1.0)},
    "camera_offset": {
        **{axis: (1e-5, 5e-4, "mm", 1e3) for axis in "xyz"},
        **{axis: (1e-5, 1.75e-3, "deg", 57.29578) for axis in ("rx", "ry", "rz")},
    },
}
# effect, parameter, sigma below which it is determined, unit, factor: in the order of `_of_time`
TIMES = (("camera_delay", "delay", 2e-3, "ms", 1e3), ("rolling_shutter", "readout", 4e-3, "ms", 1e3))
FIXTURE_PRIOR = 5e-3  # m, sigma of the known place of a thing
STEP = 1e-5  # m, of the difference that moves a thing
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
        determined: whether that is below the limit in `NUMBERS` or `TIMES`.
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


def excited(geometry: Geometry, camera: str, views: Sequence[View]) -> list[Precision]:
    """Return how well these views of a camera determine each parameter of its errors.

    Args:
        geometry: of the cell; it is moved.
        camera: its name.
        views: with borders as predicted in the nominal world.
    """
    names = [(effect, p, *spec) for effect, many in NUMBERS.items() for p, spec in many.items()]
    shifts = [(body, axis) for body in _standing(geometry) for axis in range(3)]
    size = len(names) + len(TIMES) + len(shifts)
    (height,) = [c.height for c in geometry.cameras if c.name == camera]
    information = np.zeros((size, size))
    columns: list[list[np.ndarray]] = [[] for _ in views]
    worlds = [World(effects=(EffectInstance.of(e, camera, **{p: step}),)) for e, p, step, *_ in names]
    steps = [step for _, _, step, *_ in names]
    for world, step in zip(worlds, steps, strict=True):
        geometry.place(world)
        for view, into in zip(views, columns, strict=True):
            geometry.at(view.q)
            into.append(view.borders.moved(geometry, camera) / step)
    geometry.place(World())
    for body, axis in shifts:
        geometry.model.body_pos[body, axis] += STEP
        for view, into in zip(views, columns, strict=True):
            geometry.at(view.q)
            into.append(view.borders.moved(geometry, camera) / STEP)
        geometry.model.body_pos[body, axis] -= STEP
    for view, into in zip(views, columns, strict=True):
        geometry.at(view.q - 1e-3 * view.dq)
        into[len(names) : len(names)] = _of_time(view.borders.moved(geometry, camera) / 1e-3, view.borders, height)
        information += _of_view(np.column_stack(into), _robot(into, names, view, geometry, camera))
    units = [unit for _, _, _, _, unit, _ in names] + [unit for _, _, _, unit, _ in TIMES]
    prior = [PRIOR[unit] for unit in units] + [FIXTURE_PRIOR] * len(shifts)
    sigma = np.sqrt(np.diag(np.linalg.inv(information + np.diag(1 / np.square(prior)))))
    numbers = [(effect, p, enough, unit, factor) for effect, p, _, enough, unit, factor in names] + [*TIMES]
    return [
        Precision(effect, p, float(s * factor), unit, bool(s < enough))
        for (effect, p, enough, unit, factor), s in zip(numbers, sigma, strict=False)
    ]


def _standing(geometry: Geometry) -> list[int]:
    """Return the ids of the scene's things that do not move with the arm."""
    bodies = [geometry.model.body(name).id for name in geometry.scene.things]
    return [body for body in bodies if geometry.model.body_weldid[body] == 0]


def _of_time(late: np.ndarray, borders: Borders, height: int) -> list[np.ndarray]:
    """Return the displacement (n,) of borders along their normals for a second of delay and of read-out time, px/s.

    Args:
        late: (n,) px/s, for a second of delay.
        borders: the borders; rows below the middle are read later, those above earlier.
        height: of the image, px.
    """
    return [late, late * (0.5 - borders.pixel[:, 1] / (height - 1))]


def _robot(
    into: Sequence[np.ndarray], names: Sequence[tuple], view: View, geometry: Geometry, camera: str
) -> np.ndarray:
    """Return the displacement (n, 6) px of borders for one sigma of each of the flange's errors in position and angle.

    If camera or border, and not both, are carried by the flange, it is that of the camera's offset (to within a sign,
    which does not matter, and the lever arm of the angles); otherwise they do not move relative to each other.
    """
    model = geometry.model
    flange = model.body_weldid[model.site_bodyid[model.site(geometry.scene.flange).id]]
    things = [model.body(name).id for name in geometry.scene.things]
    carried = np.isin(np.arange(model.nbody), [b for b in things if model.body_weldid[b] != 0])
    carried |= model.body_weldid == flange
    offset = np.column_stack([into[i] for i, (effect, *_) in enumerate(names) if effect == "camera_offset"])
    moves = carried[view.borders.body] != carried[geometry.carrier(camera)]
    return np.where(moves[:, None], offset, 0.0) * np.repeat([ROBOT_M, ROBOT_RAD], 3)


def _of_view(J: np.ndarray, robot: np.ndarray) -> np.ndarray:
    """Return the information J' C^-1 J of one view, C = BORDER^2 I + robot robot' (inverted by Woodbury's identity).

    Args:
        J: (n, k) px a unit, derivatives of the borders by the k unknowns.
        robot: (n, 6) px, see `_robot`.
    """
    J = np.nan_to_num(J)
    robot = np.nan_to_num(robot)
    small = np.eye(robot.shape[1]) + robot.T @ robot / BORDER**2
    cross = robot.T @ J / BORDER**2
    return J.T @ J / BORDER**2 - cross.T @ np.linalg.solve(small, cross)
