"""Blocks of a path in time, and the phase of contact that each is in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.contact.path import Path
from vispeg.recordings.regimes import REGIMES
from vispeg.robots.scene import Scene

NAMES = REGIMES
_, PRESS, SLIDE, WITHIN, IMPACT = range(len(NAMES))
TOUCH, SLIDES, INSIDE, HIT, AFTER = 2.0, 3e-3, 1e-3, 0.01, 0.05  # N, m/s, m, m/s at a make, s after it
SHORTEST, LONGEST = 0.3, 1.0  # s at the start in free air: what is needed, what is used for the sensor's zero
STILL = 0.01  # m/s
PRESSED = 8.0  # N beyond the declared tool's weight at the start, that only a contact can be


@dataclass(frozen=True)
class Phases:
    """Blocks.

    Attributes:
        time: (m,) s, middle of each block.
        code: (m,) index into NAMES.
        resting: (m,) bool: at rest in free air at the start, where the sensor's zero is taken.
        rest: these of the path's samples.
        size: samples a block.
        force: (m,) N, contact force.
        used: (m,) bool: blocks that are driven, and long enough to have forgotten how a window began.
        windows: of the path's samples that are driven.
    """

    time: np.ndarray
    code: np.ndarray
    resting: np.ndarray
    rest: slice
    size: int
    force: np.ndarray
    used: np.ndarray
    windows: tuple[slice, ...]
    names: tuple[str, ...] = NAMES

    @property
    def valid(self) -> np.ndarray:
        """(m,) bool: blocks that are compared; in the ms after a make solver and filter decide, not the model."""
        return (self.used & (self.code != IMPACT)) | self.resting

    def of(self, name: str) -> np.ndarray:
        """(m,) bool."""
        return self.code == NAMES.index(name)

    def medians(self, values: np.ndarray) -> np.ndarray:
        """(w, m, k) of (w, n, k)."""
        m = len(self.time)
        return np.median(values[:, : m * self.size].reshape(len(values), m, self.size, -1), axis=2)

    def rows(self, clock: np.ndarray) -> np.ndarray:
        """(m,) sample of a recording with this clock nearest to each block's middle."""
        return np.clip(np.searchsorted(clock, self.time), 0, len(clock) - 1)


def phases(scene: Scene, path: Path, block: float) -> Phases | None:
    """Those of a path; None where it does not begin in free air."""
    size = max(1, round(block / path.step))
    m = len(path.time) // size
    turn = Rotation.from_quat(path.frame, scalar_first=True) * Rotation.from_euler("XYZ", path.place[:, 3:])
    tip = path.origin + Rotation.from_quat(path.frame, scalar_first=True).apply(path.place[:, :3])
    tip = tip + turn.apply([0.0, 0.0, scene.tip]) - np.array(scene.target)
    velocity = np.gradient(tip, path.step, axis=0)
    weight = _tool_mass(scene) * turn.inv().apply(np.array(scene.spec().option.gravity))
    start = path.wrench[: max(1, int(0.1 / path.step)), :3].mean(axis=0) + weight[0]
    if np.linalg.norm(start) > PRESSED:
        return None
    contact = path.wrench[:, :3] + weight - start
    force = np.median(np.linalg.norm(contact, axis=1)[: m * size].reshape(m, size), axis=1)
    speed = np.median(np.linalg.norm(velocity, axis=1)[: m * size].reshape(m, size), axis=1)
    lateral = np.median(np.hypot(*velocity[:, :2].T)[: m * size].reshape(m, size), axis=1)
    depth = np.median(-tip[: m * size, 2].reshape(m, size), axis=1)
    beside = np.median(np.hypot(*tip[:, :2].T)[: m * size].reshape(m, size), axis=1)
    touching = force > TOUCH
    code = np.zeros(m, int)
    code[touching] = PRESS
    code[touching & (lateral > SLIDES)] = SLIDE
    code[(depth > INSIDE) & (beside < scene.config.diameter)] = WITHIN
    made = np.flatnonzero(touching[1:] & ~touching[:-1] & (speed[:-1] > HIT)) + 1
    for k in made:
        code[k - 1 : k + max(1, round(AFTER / block))] = IMPACT
    first = int(np.argmax(touching)) if touching.any() else m
    still = int(np.argmax(speed > STILL)) if (speed > STILL).any() else m
    blocks = min(first - 1, still, round(LONGEST / block))
    if blocks * block < SHORTEST:
        return None
    time = (np.arange(m) + 0.5) * size * path.step
    all_of_it = np.ones(m, bool), (slice(0, m * size),)
    return Phases(time, code, np.arange(m) < blocks, slice(0, blocks * size), size, force, *all_of_it)


def _tool_mass(scene: Scene) -> float:
    model = scene.nominal.compile()
    return float(sum(model.body_mass[b] for b in range(model.nbody) if model.body(b).name in ("tool", scene.held)))
