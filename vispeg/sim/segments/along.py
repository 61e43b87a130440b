"""Nominal gravity and inertia along a segment's measured motion, computed once per segment and robot and cached."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import of_postures
from vispeg.sim.nominal import Nominal
from vispeg.sim.segments.segment import Segment


def once(s: Segment, robot: RobotModel, get: Callable[[Segment, RobotModel], np.ndarray]) -> np.ndarray:
    """Return `get(s, robot)`, cached in the segment."""
    key = (get.__name__, id(robot))
    if key not in s.cache:
        s.cache[key] = get(s, robot)
    return s.cache[key]


def measured_gravity(s: Segment, robot: RobotModel) -> np.ndarray:
    """Return the gravity torque (n, nj) N m that the robot added to `tau_cmd`, from the angles that it read."""
    if s.control.gravity_compensation != "model":
        return np.zeros_like(s.q)
    return of_postures(robot, s.q_raw, _gravity)


def gravity(s: Segment, robot: RobotModel) -> np.ndarray:
    """Return the nominal gravity torque (n, nj) N m along the motion."""
    return of_postures(robot, s.q, _gravity)


def gravity_slope(s: Segment, robot: RobotModel, step: float = 1e-4) -> np.ndarray:
    """Return the derivative (n, nj, nj) N m/rad of gravity with respect to the angles, by central differences."""

    def slope(nominal: Nominal, q: np.ndarray) -> np.ndarray:
        moves = np.eye(q.shape[1]) * step
        columns = [(_gravity(nominal, q + move) - _gravity(nominal, q - move)) / (2 * step) for move in moves]
        return np.stack(columns, axis=2)

    return of_postures(robot, s.q, slope)


def inertia(s: Segment, robot: RobotModel) -> np.ndarray:
    """Return the nominal joint-space inertia (n, nj, nj) kg m^2 along the motion."""
    return _inertia_at(s.q, robot)


def apparent_inertia(s: Segment, robot: RobotModel) -> np.ndarray:
    """Return the apparent inertia 1 / (M^-1)_jj (nj,) kg m^2, the least over at most 31 samples of the motion."""
    samples = s.q[:: max(1, s.ticks // 16)]
    return np.min(1.0 / np.diagonal(np.linalg.inv(_inertia_at(samples, robot)), axis1=1, axis2=2), axis=0)


def _inertia_at(q: np.ndarray, robot: RobotModel) -> np.ndarray:
    return of_postures(robot, q, lambda nominal, block: nominal.operational(block)[0])


def _gravity(nominal: Nominal, q: np.ndarray) -> np.ndarray:
    return nominal.gravity(q).copy()
