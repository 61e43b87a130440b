"""Where a world may put the hole, and whether the arm gets its peg there."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import nominal_of
from vispeg.sim.reach import reach
from vispeg.task.start import ABOVE, DOWN, home
from vispeg.worlds.distribution import Choice, Distribution, LogUniform, Normal, Uniform
from vispeg.worlds.randomized import RandomizedEffect

RARE = 1e-3  # share of a Gaussian's draws that may lie further out than what is looked at, on either side


def check_places(scene: Scene, offset: RandomizedEffect | None, file: Path, key: str) -> None:
    """Look at the outermost places of the hole, and those nearest the base's axis.

    Args:
        scene: whose fixture stands where the task says.
        offset: a `hole_offset`; None for the fixture's own place.
        file, key: who is to blame.

    Raises:
        UserError: a hole that is out of reach or stands in the table.
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
            "the hole may stand where the arm cannot go",
            file=file,
            key=key,
            expected="places over and in which it can hold the peg upright within its joint limits",
            got=tuple(holes[far.argmax()].round(4).tolist()),
        )


def out_of_reach(scene: Scene, holes: np.ndarray) -> np.ndarray:
    """(n,) bool: whether the arm cannot hold its peg upright over and in a hole at (n, 3) m, base frame.

    As an episode goes: from above the fixture's own place.
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
    """Offsets along one axis to look at: a range's ends, and what brings a fixture `at` nearest to 0."""
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
