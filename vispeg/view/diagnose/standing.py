"""What the worker tells of a search: plain data that the page draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Named:
    """An effect in words (`Coulomb friction in joint 4`), its size (`1.20 N m`), and its name `EFFECT:WHERE`."""

    words: str
    size: str
    key: str


@dataclass(frozen=True)
class Rung:
    """A model of the ladder: what was added to the one before, and its held-out RMS error."""

    words: str
    error: float


@dataclass(frozen=True)
class Track:
    """One held-out stretch.

    Attributes:
        name: the recording's.
        time: (n,) s.
        posture: (n, nj) rad, measured.
        measured, first, now: (n, columns) in the columns' units; of the model as it was given, and as it is. Without
            `measured` they are errors.
        wrench: (n, 6) N and N m as recorded, where the recording says what it is; else None.
        cameras: names of those that took pictures.
    """

    name: str
    time: np.ndarray
    posture: np.ndarray
    measured: np.ndarray | None
    first: np.ndarray
    now: np.ndarray
    wrench: np.ndarray | None = None
    cameras: tuple[str, ...] = ()


@dataclass(frozen=True)
class Pictured:
    """A frame: its camera, when it was taken (s in its track), and pictures (H, W, 3) uint8 by name."""

    camera: str
    time: float
    pictures: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Field:
    """A map of what is off over one axis: edges (k+1,), RMS over its noise first and now (columns, k).

    `moment` (columns, k, 2) is the track and the time, s, of the worst in a cell; NaN in an empty one. Cells that are
    no ranges have `labels` (k,).
    """

    edges: np.ndarray
    first: np.ndarray
    now: np.ndarray
    moment: np.ndarray
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Standing:
    """Where a search stands.

    Attributes:
        joints: whose angles the postures are.
        columns, units: what is compared side by side, and in which unit each.
        shows: what a cell of the maps says.
        unit: of errors.
        floor: RMS of the noise.
        ladder: models, the given one first.
        effects: that were added, as they are now fitted; `initial` those of the user's model.
        tracks, maps: what was measured and predicted; maps by axis, none where torque says nothing.
        judged: whether there is a recording to judge on; only then effects can be added.
        channels, channel: those that the recordings have; the one that is looked in.
        enough: whether the error is so near the noise that nothing more could be named.
    """

    joints: tuple[str, ...]
    columns: tuple[str, ...]
    units: tuple[str, ...]
    shows: str
    unit: str
    floor: float
    ladder: tuple[Rung, ...]
    effects: tuple[Named, ...]
    initial: tuple[Named, ...]
    tracks: tuple[Track, ...]
    maps: Mapping[str, Field]
    judged: bool
    enough: bool
    channels: tuple[str, ...] = ("joints",)
    channel: str = "joints"


@dataclass(frozen=True)
class Candidate:
    """A candidate: its members as `EFFECT:WHERE` joined by `+`, in words, and the share of the error it promises."""

    key: str
    words: str
    share: float


@dataclass(frozen=True)
class Tried:
    """A candidate that was fitted: held-out error before and after, RMS; `refused` says why it does not pass."""

    words: str
    size: str
    before: float
    after: float
    refused: str
