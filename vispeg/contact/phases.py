"""Blocks of a path in time, and the phase of contact of each, as `vispeg.sim.touch` defines it by samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.contact.path import Path
from vispeg.core.rules import RULES
from vispeg.recordings.checks.quality import runs
from vispeg.recordings.regimes import IMPACT, REGIMES, Thresholds
from vispeg.robots.scene import Scene
from vispeg.sim.touch import Touch

NAMES = REGIMES
LEVER = 0.2  # m, converts rotations of the flange to displacements


@dataclass(frozen=True)
class Phases:
    """The blocks of an episode.

    Attributes:
        time: (m,) s, middle of each block.
        code: (m,) index into NAMES.
        resting: (m,) bool: at rest in free air at the start, where the sensor's zero is taken.
        rest: the path's samples in these blocks.
        size: samples per block.
        speed: (m,) m/s of the tip.
        contact: (m, 6) N, N m: what the surroundings exert on the tool, flange axes and origin.
        near: (m,) bool: touching, or the tip inside the goal, where it may touch with undetectable force.
        used: (m,) bool: blocks that are simulated, and far enough from the start of a window to be independent of it.
        windows: ranges of the path's samples that are simulated.
    """

    time: np.ndarray
    code: np.ndarray
    resting: np.ndarray
    rest: slice
    size: int
    speed: np.ndarray
    contact: np.ndarray
    near: np.ndarray
    used: np.ndarray
    windows: tuple[slice, ...]

    @property
    def force(self) -> np.ndarray:
        """Magnitude of the contact force, (m,) N."""
        return np.linalg.norm(self.contact[:, :3], axis=1)

    @property
    def valid(self) -> np.ndarray:
        """Blocks that are compared, (m,) bool; just after contact begins, solver and filter dominate."""
        return (self.used & (self.code != IMPACT)) | self.resting

    def of(self, name: str) -> np.ndarray:
        """Return the blocks of a phase, (m,) bool."""
        return self.code == NAMES.index(name)

    def means(self, values: np.ndarray) -> np.ndarray:
        """Return block means (w, m, k) of (w, n, k), which obey momentum and friction laws even if forces chatter."""
        m = len(self.time)
        return values[:, : m * self.size].reshape(len(values), m, self.size, -1).mean(axis=2)

    def scatter(self, values: np.ndarray) -> np.ndarray:
        """Return the standard deviation within each block about a straight line, (m, k) of (n, k)."""
        m = len(self.time)
        parts = values[: m * self.size].reshape(m, self.size, -1)
        line = np.stack([np.ones(self.size), np.arange(self.size)], axis=1)
        rest = parts - line @ (np.linalg.pinv(line) @ parts)
        return np.sqrt((rest**2).sum(axis=1) / max(self.size - 2, 1))

    def rows(self, clock: np.ndarray) -> np.ndarray:
        """Return the recording's sample nearest to each block's middle, (m,), by its clock."""
        return nearest(clock, self.time)


def nearest(clock: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the index of the sample of an increasing `clock` (k,) s that is nearest to each time (n,) s, (n,) int."""
    return np.rint(np.interp(time, clock, np.arange(len(clock)))).astype(int)


def phases(touch: Touch, path: Path, scene: Scene, block: float) -> Phases | None:
    """Return the phases of a path with contact `touch`; None if it does not begin in free air.

    In free air the wrench is constant at rest, and stays the same when motion begins. So the rest is the first time
    without motion or touch, provided that the force stays the same while the tool then moves. The reading there is the
    sensor's zero plus the tool's weight, whatever they are.
    """
    size = max(1, round(block / path.step))
    m = len(path.time) // size
    at = path.rows[nearest(path.clock, path.time[: m * size])]
    regime, speed = touch.regime[at].reshape(m, size), np.linalg.norm(touch.velocity[at], axis=1).reshape(m, size)
    counts = np.stack([(regime == k).sum(axis=1) for k in range(len(NAMES))], axis=1)
    code = np.where(counts[:, IMPACT] > 0, IMPACT, counts.argmax(axis=1))
    axes = Rotation.from_quat(touch.flange[at, 3:], scalar_first=True).inv()
    contact = np.concatenate([axes.apply(touch.contact[at, part]) for part in (slice(0, 3), slice(3, 6))], axis=1)
    speed = np.median(speed, axis=1)
    flange = np.hypot(np.linalg.norm(path.rate[:, :3], axis=1), LEVER * np.linalg.norm(path.rate[:, 3:], axis=1))
    moves = np.median(flange[: m * size].reshape(m, size), axis=1)  # a hand may rotate about a tip at rest
    touching = np.asarray(touch.touching[at].reshape(m, size).any(axis=1))
    moving = np.maximum(speed, moves) > Thresholds().hit
    rest = _rest(touching, moving, block)
    if rest is None:
        return None
    steps = slice(rest.start * size, rest.stop * size)
    if not _leaves(path, steps, contact, touch.touching[at]):
        return None
    time = (np.arange(m) + 0.5) * size * path.step
    everything = np.ones(m, bool), (slice(0, m * size),)
    middle = np.median(contact.reshape(m, size, 6), axis=1)
    apothem = scene.config.apothem  # m, from the believed goal's axis to its walls
    over = np.hypot(touch.tip[at, 0], touch.tip[at, 1]) < 2 * apothem
    near = (over & (touch.tip[at, 2] < 0)).reshape(m, size).any(axis=1) | touching
    resting = (np.arange(m) >= rest.start) & (np.arange(m) < rest.stop)
    return Phases(time, code, resting, steps, size, speed, middle, near, *everything)


def _rest(touching: np.ndarray, moving: np.ndarray, block: float) -> slice | None:
    """Return the first rest, in blocks, before any block touches; None if no rest is long enough.

    `touching` and `moving` are (m,) bool, `block` is the duration of a block, s.
    """
    first = int(np.argmax(touching)) if touching.any() else len(touching)
    for a, b in runs(~(touching | moving)[:first]):
        # one block of margin, since a block counts as still by the median of its samples
        begin, end = a + (a > 0), min(b - 1, a + (a > 0) + round(RULES.rest_most / block))
        if (end - begin) * block >= RULES.rest_least:
            return slice(begin, end)
    return None


def _leaves(path: Path, rest: slice, contact: np.ndarray, touching: np.ndarray) -> bool:
    """Return whether a tool leaves its rest (samples) without the force change of a contact there.

    `contact` (n, 6) and `touching` (n,) are by samples. If the tool were pressed on a surface of stiffness k, its
    reading would change by k times its displacement until it is lifted off; in free air it stays the same, however
    heavy the tool is. Motion within the kinematic error does not count.
    """
    if not touching.any():
        return True
    still, way = contact[rest, :3], slice(rest.stop, max(int(np.argmax(touching)), rest.stop + 1))
    moved = path.place[way] - path.place[rest.stop - 1]
    gone = np.hypot(np.linalg.norm(moved[:, :3], axis=1), LEVER * np.linalg.norm(moved[:, 3:], axis=1))  # m
    change = np.linalg.norm(contact[way, :3] - still.mean(axis=0), axis=1)
    scatter = float(np.sqrt(still.var(axis=0).sum()))
    return bool(np.any(change + RULES.rest_sigmas * scatter < RULES.rest_softest * (gone - RULES.kinematics_place)))


def tool_mass(scene: Scene) -> float:
    """Return the mass of tool and part in the cell, kg."""
    model = scene.nominal.compile()
    return float(sum(model.body_mass[b] for b in range(model.nbody) if model.body(b).name in ("tool", scene.held)))
