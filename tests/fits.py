"""Real evidence, judges and fits for the tests of a search; their errors are stated by a test, not simulated."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from loops import pendulum

from vispeg.core.rules import RULES
from vispeg.diagnosis.selection.judge import Judge
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.identify.space import Space
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.model import RobotModel
from vispeg.worlds.world import World

RATE = 100.0  # Hz: 25 readings in a block of time


SETTLES = float(RULES.block * np.ceil(RULES.settle / RULES.block))  # s that are not compared, in whole blocks of time


def still(robot: RobotModel, seconds: float = 10.0, name: str = "still", control: Control | None = None) -> Recording:
    """Record a robot under position control at rest, at 100 Hz; `seconds` s are compared after the settling time."""
    nj = len(robot.joints)
    time = np.arange(round((SETTLES + seconds) * RATE)) / RATE
    control = control or Control("position", RATE, "none", np.full(nj, 60.0), np.full(nj, 4.0))
    rest = np.zeros((len(time), nj))
    read = np.where((time > RULES.settle / 2)[:, None] & (time < SETTLES)[:, None], np.nan, rest)
    return Recording(Path(name), robot.source, robot.joints, RATE, control, time, read, q_cmd=rest, noise={"q": 2e-5})


@lru_cache
def evidence() -> Evidence:
    """A pendulum at rest for 40 blocks of time with 25 readings each."""
    return Evidence([still(pendulum())])


@lru_cache
def judge() -> Judge:
    """The judge on that recording."""
    return Judge(evidence())


def lost(values: np.ndarray | float) -> np.ndarray:
    """Return the loss (nblock, 1) of a world with these mean squared residuals in the 40 blocks of `evidence`."""
    loss = np.zeros_like(judge().size)
    loss[judge().size > 0] = 25.0 * np.broadcast_to(np.ravel(values), 40)
    return loss


def fit(
    world: World,
    free: Sequence[int] | None = None,
    *,
    residual: np.ndarray | None = None,
    jacobian: np.ndarray | None = None,
    u: np.ndarray | None = None,
    correlation: np.ndarray | None = None,
) -> Fit:
    """A fit of the effects at `free`, by default of all, that ended at the world's values, or at `u`.

    The residual is one reading of 0, and derivatives are 0, unless they are given.
    """
    space = Space(world, range(len(world.effects)) if free is None else free)
    residual = np.zeros(1) if residual is None else residual
    count = len(space.axes)
    jacobian = np.zeros((len(residual), count)) if jacobian is None else jacobian
    ended = space.start if u is None else u
    world = world if u is None else space.at(u)
    correlation = np.eye(count) if correlation is None else correlation
    return Fit(
        world, residual, (jacobian,), space, ended, np.zeros(count), correlation, cost=float(np.mean(residual**2))
    )
