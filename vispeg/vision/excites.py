"""Which errors of a camera a set of frames can tell: what its borders would say of each, all of them unknown at once.

Borders move by the projection alone, so their derivatives by each number of each effect come from finite differences
without drawing. All numbers of a camera are free together with where things stand; the robot's own repeatability
moves each view anew. What motions leave in the dark: see `vispeg.identify.motions.look_motion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.vision.borders import Borders
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

# effect -> parameter: step of the difference, what counts as told (1 sigma), unit it is said in, factor to it
NUMBERS: dict[str, dict[str, tuple[float, float, str, float]]] = {
    "focal_error": {"fx": (1e-4, 2e-3, "%", 100.0), "fy": (1e-4, 2e-3, "%", 100.0)},
    "principal_point_error": {"x": (1e-2, 0.5, "px", 1.0), "y": (1e-2, 0.5, "px", 1.0)},
    "lens_distortion": {"k1": (1e-4, 5e-3, "1", 1.0)},
    "camera_offset": {
        **{axis: (1e-5, 5e-4, "mm", 1e3) for axis in "xyz"},
        **{axis: (1e-5, 1.75e-3, "deg", 57.29578) for axis in ("rx", "ry", "rz")},
    },
}
# effect, parameter, what counts as told, unit, factor: in the order of `_of_time`
TIMES = (("camera_delay", "delay", 2e-3, "ms", 1e3), ("rolling_shutter", "readout", 4e-3, "ms", 1e3))
FIXTURE_PRIOR = 5e-3  # m: where a thing stands is known no better
STEP = 1e-5  # m, of the difference that moves a thing
ROBOT_M, ROBOT_RAD = 1e-4, 3.5e-4  # m, rad: how well an arm comes back to a pose
BORDER = 1.5  # px, of a border by itself: 0.3 px, of which twenty neighbours share the same error
PRIOR = {"%": 0.2, "px": 30.0, "1": 0.2, "mm": 0.1, "deg": 0.2, "ms": 0.5}  # far beyond anything: keeps inverses finite


@dataclass(frozen=True)
class Precision:
    """How well one number of an effect would be known. `sigma` in `unit`; `determined`: whether that is well enough."""

    effect: str
    parameter: str
    sigma: float
    unit: str
    determined: bool


@dataclass(frozen=True, eq=False)
class View:
    """One frame: its borders, the joint angles there, and how fast they change. (n,), (nj,) rad, (nj,) rad/s."""

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
        information += _of_view(np.column_stack(into), _robot(into, names, view, geometry))
    units = [unit for _, _, _, _, unit, _ in names] + [unit for _, _, _, unit, _ in TIMES]
    prior = [PRIOR[unit] for unit in units] + [FIXTURE_PRIOR] * len(shifts)
    sigma = np.sqrt(np.diag(np.linalg.inv(information + np.diag(1 / np.square(prior)))))
    numbers = [(effect, p, enough, unit, factor) for effect, p, _, enough, unit, factor in names] + [*TIMES]
    return [
        Precision(effect, p, float(s * factor), unit, bool(s < enough))
        for (effect, p, enough, unit, factor), s in zip(numbers, sigma, strict=False)
    ]


def _standing(geometry: Geometry) -> list[int]:
    """Ids of the scene's things that do not move with the arm."""
    bodies = [geometry.model.body(name).id for name in geometry.scene.things]
    return [body for body in bodies if geometry.model.body_weldid[body] == 0]


def _of_time(late: np.ndarray, borders: Borders, height: int) -> list[np.ndarray]:
    """(n,) px along their normals that borders move by a second of delay, and of read-out: lower rows see them later.

    Args:
        late: that of a second of delay.
        borders: where they lie.
        height: of the image, px.
    """
    return [late, late * (0.5 - borders.pixel[:, 1] / (height - 1))]


def _robot(into: Sequence[np.ndarray], names: Sequence[tuple], view: View, geometry: Geometry) -> np.ndarray:
    """(n, 6) px a unit of what the arm's own error does: as the camera's offset, but not to what the hand carries."""
    offset = [i for i, (effect, *_) in enumerate(names) if effect == "camera_offset"]
    flange = int(geometry.model.site_bodyid[geometry.model.site(geometry.scene.flange).id])
    hand = geometry.model.body_weldid[view.borders.body] == geometry.model.body_weldid[flange]
    held = [geometry.model.body(name).id for name in geometry.scene.things]
    carried = np.isin(view.borders.body, [b for b in held if geometry.model.body_weldid[b] != 0])
    moved = np.column_stack([into[i] for i in offset])
    return np.where((hand | carried)[:, None], 0.0, moved) * np.repeat([ROBOT_M, ROBOT_RAD], 3)


def _of_view(J: np.ndarray, robot: np.ndarray) -> np.ndarray:
    """J' C^-1 J of one view, C = BORDER^2 I + robot robot' (Woodbury)."""
    J = np.nan_to_num(J)
    robot = np.nan_to_num(robot)
    small = np.eye(robot.shape[1]) + robot.T @ robot / BORDER**2
    cross = robot.T @ J / BORDER**2
    return J.T @ J / BORDER**2 - cross.T @ np.linalg.solve(small, cross)
