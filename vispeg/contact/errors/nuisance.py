"""Sensor and kinematic errors over a whole recording, as a covariance of the residual.

A force sensor drifts and mixes its channels; kinematics have small errors that change slowly over the cell. Such
errors are correlated between blocks, so a noise floor per block cannot describe them. They are linear in the compared
wrench: the covariance of whitened residuals is `I + A A'`, with a column of A each, and the residuals are whitened
again by its inverse root (`vispeg.identify.whitener`). Sources: Bayarri and others
2007, A framework for validation of computer models, Technometrics 49(2), for a smooth discrepancy; Rasmussen and
Williams 2006, Gaussian Processes for Machine Learning, 2.7, for linear nuisances in a covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.contact.errors.bearing import bearing
from vispeg.contact.hand import UNITS, stiffness
from vispeg.contact.inputs import ContactItem
from vispeg.contact.phases import NAMES
from vispeg.core.rules import RULES
from vispeg.identify.whitener import Whitener
from vispeg.recordings.checks.quality import runs
from vispeg.recordings.regimes import Thresholds
from vispeg.sim.compiled import compiled

KINDS = ("sensor", "path", "form")
READING, PATH, FORM = range(len(KINDS))
TOUCH = Thresholds().touch  # N, least contact force that constrains the position


@dataclass(frozen=True)
class Nuisance:
    """Directions of the whitened residual with more uncertainty than its floor.

    Attributes:
        columns: (n, j) columns of A, over all blocks and channels of one item, or of several one after another.
        kinds: (j,) kind of each column, an index of `KINDS`.
        whitener: whitens by its covariance.
    """

    columns: np.ndarray
    kinds: np.ndarray
    whitener: Whitener

    @classmethod
    def of(cls, columns: np.ndarray, kinds: np.ndarray | None = None) -> Nuisance:
        """Build from the columns (n, j) of A: each is the whitened residual due to an error of 1 standard deviation."""
        kinds = np.zeros(columns.shape[1], int) if kinds is None else kinds
        return cls(columns, kinds, Whitener.of(columns))

    def taken(self, residual: np.ndarray) -> dict[str, float]:
        """Return for each kind of error the share of a squared residual that it explains at its most likely size.

        The residual r is whitened block by block. With `x ~ N(0, I)` and `r = A x + n`, the most likely sizes are
        `x = A' (I + A A')^-1 r`.
        """
        flat, a = residual.ravel(), self.columns
        likely = np.linalg.solve(np.eye(a.shape[1]) + a.T @ a, a.T @ flat)
        out, square = {}, max(float(flat @ flat), 1e-300)
        for k, name in enumerate(KINDS):
            rest = flat - a[:, self.kinds == k] @ likely[self.kinds == k]
            out[name] = max(0.0, 1.0 - float(rest @ rest) / square)
        return out

    def whitened(self, residual: np.ndarray) -> np.ndarray:
        """Whiten a residual of `n` values that is already white block by block, by the covariance of the nuisances."""
        return self.whitener(residual.ravel()).reshape(residual.shape)


def nuisance(items: Sequence[ContactItem]) -> Nuisance:
    """Return the covariance of items of one robot and sensor, with their floors, in the order of the residual."""
    sizes = [i.measured.size for i in items]
    ends = np.cumsum([0, *sizes])
    separate, of_separate, shared, of_shared = [], [], [], []
    for item, error in zip(items, _smooth(items), strict=True):
        read = _taken_up(item, [*_drifts(item), *_unsure(item)])
        path, form = _turned(item), [*_stuck(item), *_swings(item), *bearing(item)]
        separate.append(_whitened(item, [*read, *path, *form]))
        of_separate.append(np.repeat([READING, PATH, FORM], [len(read), len(path), len(form)]))
        read, path = _taken_up(item, _mixtures(item)), _misplaced(item, error)
        shared.append(_whitened(item, [*read, *path]))
        of_shared.append(np.repeat([READING, PATH], [len(read), len(path)]))
    columns = np.concatenate(shared, axis=0)
    out = np.zeros((ends[-1], columns.shape[1] + sum(o.shape[1] for o in separate)))
    out[:, : columns.shape[1]], at = columns, columns.shape[1]
    for start, end, own in zip(ends[:-1], ends[1:], separate, strict=True):
        out[start:end, at : at + own.shape[1]] = own
        at += own.shape[1]
    return Nuisance.of(out, np.concatenate([of_shared[0], *of_separate]))


def _whitened(item: ContactItem, columns: Sequence[np.ndarray]) -> np.ndarray:
    """Return columns (m, 6) whitened block by block, (6 m, k)."""
    return np.stack([np.nan_to_num(np.where(item.valid, c / item.sigma, 0.0)).ravel() for c in columns], axis=1)


def _taken_up(item: ContactItem, errors: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the part of reading errors, (m, 6) each, that remains in the compared wrench: contact absorbs the rest."""
    return [np.einsum("mij,mj->mi", item.reading_response, error) for error in errors]


def _drifts(item: ContactItem) -> list[np.ndarray]:
    """Return two drifts per channel: a zero that drifts steadily from rest, and one that rises and falls back."""
    along = np.maximum(item.phase.time - item.phase.time[item.phase.resting].mean(), 0.0)
    along /= along[-1]
    size = RULES.zero * UNITS
    return [shape[:, None] * np.eye(6)[c] * size[c] for shape in (along, along * (1 - along)) for c in range(6)]


def _unsure(item: ContactItem) -> list[np.ndarray]:
    """Return the effect of joint torque errors of typical size, and unobservable directions, (m, 6) N and N m each.

    Empty if a wrench was measured.
    """
    estimate = item.source.torques
    if estimate is None:
        return []
    rows = item.path.rows[item.phase.rows(item.path.clock)]
    time, gain = item.phase.time, estimate.gain[rows]
    out = []
    for j, size in enumerate(estimate.steady):
        push = size * gain[:, :, j]
        for middle in np.arange(0.0, time[-1] + RULES.torque_holds, RULES.torque_holds):
            hat = np.maximum(0.0, 1 - np.abs(time - middle) / RULES.torque_holds)
            out.append(push * hat[:, None])
    for b, along in enumerate(estimate.blind[rows]):
        for column in along.T[np.abs(along).max(axis=0) > 0]:
            error = np.zeros((len(rows), 6))
            error[b] = column
            out.append(error)
    return out


def _mixtures(item: ContactItem) -> list[np.ndarray]:
    """Return the cross-talk of each pair of channels: a share of one's reading, relative to rest, in the other."""
    read = item.measured - item.measured[item.phase.resting].mean(axis=0)
    return [
        RULES.cross_talk * np.outer(read[:, source] / UNITS[source], np.eye(6)[into] * UNITS[into])
        for source in range(6)
        for into in range(6)
    ]


def _bound(item: ContactItem) -> tuple[np.ndarray, np.ndarray]:
    """Return the direction w (m, 6) of the measured contact wrench, and `w (w' K^-1 w)^-1`.

    The latter is the response of the hand, held to its path by springs K, to a path error along w where contact
    constrains it.
    """
    contact = item.phase.contact
    force = np.linalg.norm(contact[:, :3], axis=1)
    w = contact / np.maximum(force, TOUCH)[:, None]
    w[force < TOUCH] = 0.0
    gain = 1 / np.maximum(np.einsum("bi,i,bi->b", w, 1 / stiffness(), w), 1e-12)
    return w, w * gain[:, None]


def _smooth(items: Sequence[ContactItem]) -> list[np.ndarray]:
    """Return for each item (m, k) unit errors that vary slowly over the flange's places, as one function for all items.

    They are the principal components of a Gaussian process. A turn about the flange's own axis, by the last joint
    alone, moves it nowhere.
    """
    places = []
    for item in items:
        at = item.path.place[item.phase.rows(item.path.time), :3]
        places.append(item.path.origin + Rotation.from_quat(item.path.frame, scalar_first=True).apply(at))
    every = np.concatenate(places) / RULES.kinematics_far
    square = (every**2).sum(axis=1)
    kernel = np.exp(-0.5 * np.maximum(square[:, None] + square[None] - 2 * every @ every.T, 0.0))
    value, vector = np.linalg.eigh(kernel)
    kept = value > 1e-3 * value[-1]
    return np.split(vector[:, kept] * np.sqrt(value[kept]), np.cumsum([len(p) for p in places])[:-1])


def _misplaced(item: ContactItem, smooth: np.ndarray) -> list[np.ndarray]:
    """Return the wrench due to each of the `smooth` (m, k) unit errors of the kinematics, along each base axis.

    It is the larger of the model's response and that of the measured contact, plus the force of the tool's mass under
    the false acceleration of a path with this error.
    """
    axes = _turn(item).inv().as_matrix()
    w, held = _bound(item)
    start = Rotation.from_quat(item.path.frame, scalar_first=True).as_matrix()
    model = np.einsum("aj,jmc->amc", start, item.path_response[:3])
    measured = held[None] * (RULES.kinematics_place * np.einsum("bij,bi->jb", axes, w[:, :3]))[:, :, None]
    response = _larger(model, measured)
    bent = np.gradient(np.gradient(smooth, item.period, axis=0), item.period, axis=0)  # 1/s^2: false acceleration
    mass, centre = _tool(item)
    out = []
    for a in range(3):
        force = mass * RULES.kinematics_place * axes[:, :, a]
        free = np.concatenate([force, np.cross(centre, force)], axis=1)
        out += [response[a] * s[:, None] + free * b[:, None] for s, b in zip(smooth.T, bent.T, strict=True)]
    return out


def _turned(item: ContactItem) -> list[np.ndarray]:
    """Return the wrench due to rotation errors of the hand, constant over an item, about each of three axes."""
    w, held = _bound(item)
    measured = held[None] * (RULES.kinematics_turn * w[:, 3:]).T[:, :, None]
    return list(_larger(item.path_response[3:], measured))


def _larger(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the larger of two responses (k, m, 6), by norm in each block."""
    return np.where((np.linalg.norm(b, axis=2) > np.linalg.norm(a, axis=2))[:, :, None], b, a)


def _tool(item: ContactItem) -> tuple[float, np.ndarray]:
    """Return mass, kg, and centre of mass (3,) m, flange axes, of the load at the flange."""
    model = compiled(item.armless)
    tool = model.body(item.armless.base).id
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    site = data.site("flange")
    centre = site.xmat.reshape(3, 3).T @ (data.subtree_com[tool] - site.xpos)
    return float(model.body_subtreemass[tool]), centre


def _stuck(item: ContactItem) -> list[np.ndarray]:
    """Return the wrench along the surface due to the uncertain sticking point of a contact.

    It is the force of the hand's springs for a position error of the kinematics.
    """
    phase, turn = item.phase, _turn(item)
    size = RULES.kinematics_place * stiffness()[0]
    out = []
    for a, b in runs(phase.of("press")):
        for along in np.eye(3)[:2]:
            push = np.zeros((len(phase.time), 3))
            push[a:b] = turn[a:b].inv().apply(size * along)
            out.append(_at_tip(item, push))
    return out


def _swings(item: ContactItem) -> list[np.ndarray]:
    """Return the drag across the direction of sliding, (m, 6) N and N m for each slide.

    In the model every slide chatters, however smooth it is: a convex contact opens as it slides (MuJoCo 4.0 manual,
    Computation, Contact). A tool whose mass is off its axis then swings sideways with every hop.
    """
    phase, turn = item.phase, _turn(item)
    across = RULES.slide_across * np.cross([0.0, 0.0, 1.0], turn.apply(phase.contact[:, :3]))
    out = []
    for a, b in runs((phase.code != NAMES.index("free")) & (phase.speed > Thresholds().slide)):
        push = np.zeros_like(across)
        push[a:b] = turn[a:b].inv().apply(across[a:b])
        out.append(_at_tip(item, push))
    return out


def _turn(item: ContactItem) -> Rotation:
    """Return the orientation of the flange in the base, block by block."""
    path = item.path
    angles = path.place[item.phase.rows(path.time), 3:]
    return Rotation.from_quat(path.frame, scalar_first=True) * Rotation.from_euler("XYZ", angles)


def _at_tip(item: ContactItem, push: np.ndarray) -> np.ndarray:
    """Return the wrench (m, 6) at the flange of forces (m, 3) N at the tool's tip, flange axes."""
    return np.concatenate([push, np.cross([0.0, 0.0, item.source.scene.tip], push)], axis=1)
