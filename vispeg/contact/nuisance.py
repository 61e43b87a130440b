"""What sensors leave open over a whole recording, and what the residual therefore must not be read as.

A sensor of forces drifts and mixes its channels; kinematics are off by a little that changes slowly over the cell. Such
errors hang together from block to block, so no floor of single blocks can stand for them. They are linear in the
compared wrench: the covariance of whitened residuals is `I + A A'`, a column of A each, and they are whitened once more
by its inverse root, `I - U diag(1 - 1/sqrt(1 + s^2)) U'` with `A = U diag(s) V'`. Sources: Bayarri and others 2007, A
framework for validation of computer models, Technometrics 49(2), for a smooth discrepancy; Rasmussen and Williams 2006,
Gaussian Processes for Machine Learning, 2.7, for linear nuisances in a covariance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.contact.phases import NAMES
from vispeg.contact.torques import unsure
from vispeg.recordings.regimes import Thresholds

if TYPE_CHECKING:
    from vispeg.contact.evidence import ContactItem

DRIFT, CROSS, LEVER = 0.15, 0.01, 0.1  # N over a recording; share of another channel; m, of a torque against a force
PLACE, TURN = 1e-4, 2e-4  # m, rad: by how much a robot's forward kinematics are off within a cell
TOUCH = Thresholds().touch  # N, of contact that a place binds
FAR = 0.02  # m over which that changes
CHATTER = 0.1  # of the scatter of a slide's readings, by which they are off on the average
BEFORE = 5  # blocks before a tip sticks, whose blows say where it came to stick
STUCK = 0.005  # m/s, of a tip below which it sticks
LEAST = 0.05  # score below which a direction is no nuisance


@dataclass(frozen=True)
class Nuisance:
    """Directions of the whitened residual of one item that are less sure than its floor.

    Attributes:
        basis: (6 m, k) orthonormal.
        less: (k,) share of the residual along each that is taken off.
    """

    basis: np.ndarray
    less: np.ndarray

    @classmethod
    def of(cls, columns: np.ndarray) -> Nuisance:
        """Of the columns (6 m, n) of A, each the whitened residual of one error of its usual size."""
        u, s, _ = np.linalg.svd(columns, full_matrices=False)
        u, s = u[:, s > LEAST], s[s > LEAST]
        return cls(u, 1 - 1 / np.sqrt(1 + s**2))

    def whitened(self, residual: np.ndarray) -> np.ndarray:
        """(m, 6) of a residual (m, 6) that is whitened block by block."""
        flat = residual.ravel()
        return (flat - self.basis @ (self.less * (self.basis.T @ flat))).reshape(residual.shape)


def nuisance(item: ContactItem) -> Nuisance:
    """That of an item with its floor."""
    columns = [*_drifts(item), *_mixtures(item), *_misplaced(item), *_stuck(item), *_chatters(item), *unsure(item)]
    return Nuisance.of(np.stack([np.nan_to_num(np.where(item.valid, c / item.sigma, 0.0)).ravel() for c in columns], 1))


def _drifts(item: ContactItem) -> list[np.ndarray]:
    """Of each channel: a zero that moves on steadily from rest, and one that comes to an end."""
    along = np.maximum(item.phase.time - item.phase.time[item.phase.resting].mean(), 0.0)
    along /= along[-1]
    size = DRIFT * _units()
    return [shape[:, None] * np.eye(6)[c] * size[c] for shape in (along, along * (1 - along)) for c in range(6)]


def _mixtures(item: ContactItem) -> list[np.ndarray]:
    """Of each pair of channels: a share of what one reads, beyond what it did at rest, in the other."""
    read = item.measured - item.measured[item.phase.resting].mean(axis=0)
    unit = _units()
    return [
        CROSS * np.outer(read[:, source] / unit[source], np.eye(6)[into] * unit[into])
        for source in range(6)
        for into in range(6)
    ]


def _misplaced(item: ContactItem) -> list[np.ndarray]:
    """Contact where the kinematics are off: the hand, held to its path by springs K, gives way by the wrench that binds
    it, `w (w' K^-1 w)^-1` times the way off along w, where w is the direction of the measured contact wrench.
    """
    path, phase = item.path, item.phase
    at, axes = phase.rows(path.time), _turn(item).as_matrix()
    contact = phase.contact
    force = np.linalg.norm(contact[:, :3], axis=1)
    w = contact / np.maximum(force, TOUCH)[:, None]
    w[force < TOUCH] = 0.0
    gain = 1 / np.maximum(np.einsum("bi,i,bi->b", w, 1 / item.grasp.stiffness, w), 1e-12)
    held = w * gain[:, None]
    off = np.concatenate([PLACE * np.einsum("bij,bj->bi", axes, w[:, :3]), TURN * w[:, 3:]], axis=1)
    place = path.place[at, :3]
    apart = np.sum((place[:, None] - place[None]) ** 2, axis=2)
    alike = np.exp(-0.5 * apart / FAR**2)
    value, vector = np.linalg.eigh(alike)
    some = value > 1e-3 * value[-1]
    smooth = vector[:, some] * np.sqrt(value[some])
    out = [held * (off[:, a] * s)[:, None] for a in range(3) for s in smooth.T]
    return out + [held * off[:, a, None] for a in range(3, 6)]


def _stuck(item: ContactItem) -> list[np.ndarray]:
    """While a contact sticks: where exactly it came to stick, by its place or by the blows it ended with. The hand's
    springs push along the surface by as much.
    """
    phase, turn = item.phase, _turn(item)
    blows = np.linalg.norm(phase.scatter(item.path.wrench[:, :3]), axis=1)
    sticks = (phase.code == NAMES.index("press")) & (phase.speed < STUCK)
    edges = np.flatnonzero(np.diff(np.r_[0, sticks.astype(int), 0]))
    out = []
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        size = np.hypot(PLACE * item.grasp.stiffness[0], CHATTER * blows[max(a - BEFORE, 0) : a].max(initial=0.0))
        for along in np.eye(3)[:2]:
            push = np.zeros((len(phase.time), 3))
            push[a:b] = turn[a:b].inv().apply(size * along)
            out.append(_at_tip(item, push))
    return out


def _chatters(item: ContactItem) -> list[np.ndarray]:
    """Where a slide chatters, its blows push against it and up, by the same share of their size all along."""
    phase, turn = item.phase, _turn(item)
    slides = (phase.code != NAMES.index("free")) & (phase.speed >= STUCK)
    size = np.linalg.norm(phase.scatter(item.path.wrench[:, :3]), axis=1) * slides
    force = turn.apply(phase.contact[:, :3])
    up = np.array([0.0, 0.0, 1.0])
    drag = force * (1 - up)
    drag /= np.maximum(np.linalg.norm(drag, axis=1), TOUCH)[:, None]
    pushes = [CHATTER * size[:, None] * way for way in (drag, np.tile(up, (len(size), 1)))]
    return [_at_tip(item, turn.inv().apply(push)) for push in pushes]


def _turn(item: ContactItem) -> Rotation:
    """Of the flange in the base, block by block."""
    path = item.path
    angles = path.place[item.phase.rows(path.time), 3:]
    return Rotation.from_quat(path.frame, scalar_first=True) * Rotation.from_euler("XYZ", angles)


def _at_tip(item: ContactItem, push: np.ndarray) -> np.ndarray:
    """(m, 6) wrench at the flange of forces (m, 3) N at the tool's tip, flange axes."""
    return np.concatenate([push, np.cross([0.0, 0.0, item.source.scene.tip], push)], axis=1)


def _units() -> np.ndarray:
    return np.repeat([1.0, LEVER], 3)
