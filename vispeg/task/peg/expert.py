"""A scripted policy with the observations of a `state` policy: hover, lower, search in a spiral, push down.

It acts only on errors that a student policy observes as well, so that it can be imitated. Spiral search after Chhatpar
and Branicky, "Search strategies for peg-in-hole assemblies with position uncertainty", IROS 2001.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vispeg.interface.observer import DOF
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.terms import TERMS
from vispeg.task.terms import Observation

HOVER = 0.004  # m, height at which the lateral error is removed before lowering
TOUCHING = 2.0  # N
PITCH, STEP = 0.0008, 0.0008  # m: radial distance between turns of the spiral, arc length per policy step


class Expert:
    """The scripted policy for n rows.

    Args:
        config: the task.
        nsim: rows.
    """

    def __init__(self, config: PegConfig, nsim: int):
        self.config, self.observed = config, Observation(TERMS, config)
        self.angle, self.searching = np.zeros(nsim), np.zeros(nsim, dtype=bool)

    def reset(self, rows: np.ndarray) -> None:
        """Reset the search of these rows for a new episode."""
        self.angle[rows], self.searching[rows] = 0.0, False

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return actions (n, len(dof)) in [-1, 1] from the observation `policy` (n, ..), laid out by `PegTask.terms`.

        With rotation among its degrees of freedom it also turns the peg upright.
        """
        c, terms = self.config, observation["policy"]
        tip, force = self._read("tip", terms), self._read("force", terms)
        up = force[:, 2]
        inside = tip[:, 2] < -0.003
        self.searching |= (up > TOUCHING) & (np.abs(tip[:, 2]) < 0.003)
        self.searching &= ~inside
        radius = PITCH * self.angle / (2 * np.pi)
        self.angle = np.where(self.searching, self.angle + STEP / np.maximum(radius, STEP), self.angle)
        spiral = np.where(self.searching, radius, 0.0)[:, None] * np.stack([np.cos(self.angle), np.sin(self.angle)], 1)
        error = spiral - tip[:, :2]
        aligned = np.hypot(*(tip[:, :2]).T) < 0.0015
        # vertical offsets, m per policy step; above HOVER a tip that is not aligned is lowered to HOVER only
        far = np.where(aligned, -0.006, HOVER - tip[:, 2])
        close = np.where(aligned, -0.003, 0.0)
        down = np.where(tip[:, 2] > HOVER + 0.002, far, close)
        down = np.where(self.searching, -0.002, np.where(inside, -0.006, down))
        # in the hole, give way to its wall by 0.075 mm per N, at most 2 mm
        yielding = np.clip(0.5 * force[:, :2] / 20.0 * 0.003, -0.002, 0.002)
        lateral = np.where(inside[:, None], yielding, error)
        action = np.zeros((len(terms), len(DOF)))
        action[:, :3] = np.concatenate([lateral, down[:, None]], axis=1) / c.offset
        if c.turns:
            action[:, 3:] = -self.observed.term("turn").scale * terms[:, self.observed["turn"]] / c.turn
        return np.clip(action[:, [DOF.index(d) for d in c.dof]], -1.0, 1.0).astype(np.float32)

    def _read(self, name: str, terms: np.ndarray) -> np.ndarray:
        """Return a term (n, size) of the newest time step, in its unit."""
        return self.observed.term(name).scale * terms[:, self.observed[name]].astype(float)
