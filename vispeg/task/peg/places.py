"""Check that the arm can reach the hole at every place where a world may put it."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.interface.observer import DOWN
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import nominal_of
from vispeg.sim.reach import reach
from vispeg.task.start import ABOVE, home
from vispeg.worlds.distribution import Choice, Distribution, LogUniform, Normal, Uniform
from vispeg.worlds.randomized import RandomizedEffect

RARE = 1e-3  # share of a Gaussian's draws on either side that may lie beyond the checked places


def check_places(scene: Scene, offset: RandomizedEffect | None, file: Path, key: str) -> None:
    """Check the outermost places of the hole, and those nearest the base's axis.

    Args:
        scene: the cell, with the fixture at the place that the task states.
        offset: the world's `hole_offset`; None to check the fixture's own place.
        file, key: file and key that state the place, for the error.

    Raises:
        UserError: a hole out of the arm's reach, or a fixture at an impossible place (such as in the table).
    """
    fixture = scene.config.fixture
    params = offset.params if offset is not None else {}
    ends = [_ends(params.get(axis, 0.0), at) for axis, at in zip("xyz", fixture, strict=True)]
    holes = np.array([np.add(fixture, by) for by in product(*ends)])
    for hole in holes:
        try:
            replace(scene.config, fixture=tuple(hole.round(6).tolist()))
        except UserError as error:
            raise UserError(str(error), file=file, key=key) from error
    far = out_of_reach(scene, holes)
    if far.any():
        raise UserError(
            "the arm cannot reach the hole at some of its places",
            file=file,
            key=key,
            expected="places over and in which it can hold the peg upright within its joint limits",
            got=tuple(holes[far.argmax()].round(4).tolist()),
        )


def out_of_reach(scene: Scene, holes: np.ndarray) -> np.ndarray:
    """Return whether holes are out of reach, (n,) bool, for holes at (n, 3) m in the base frame.

    A hole is in reach if the arm can hold its peg upright both over it and at its bottom, within its joint limits. As
    in an episode, inverse kinematics starts from the posture over the fixture's own place.
    """
    above, bottom = np.array([0, 0, scene.tip + ABOVE]), np.array([0, 0, scene.tip - scene.config.depth])
    flange = np.concatenate([holes + above, holes + bottom])
    n = len(flange)
    nominal, down = nominal_of(scene.nominal, n), np.tile(DOWN, (n, 1))
    start, _ = reach(nominal, np.tile(scene.config.fixture + above, (n, 1)), down, np.tile(home(scene), (n, 1)))
    q, error = reach(nominal, flange, down, start)
    low, high = scene.range.T
    far = (error > 1e-4) | (q < low).any(axis=1) | (q > high).any(axis=1)
    return far.reshape(2, -1).any(axis=0)


def _ends(value: float | Distribution, at: float) -> set[float]:
    """Return the offsets along one axis to check: a range's ends, and the offset that brings a fixture `at` nearest 0.

    `at` is the fixture's coordinate along that axis, m, base frame.
    """
    match value:
        case Uniform(low, high) | LogUniform(low, high):
            pass
        case Normal():
            low, high = value.at(RARE), value.at(1 - RARE)
        case Choice(values):
            return set(values)
        case _:
            return {float(value)}
    return {low, high, min(max(-at, low), high)}
