"""The state of a search as plain data, which the worker sends and the page draws."""

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
    """One model of the ladder: what was changed in the previous model, and the held-out RMS error with it."""

    words: str
    error: float


@dataclass(frozen=True)
class Track:
    """One compared segment of a recording.

    Attributes:
        name: name of the recording or of its part.
        time: (n,) time, s.
        posture: (n, nj) measured joint angles, rad.
        measured: (n, columns) measured values in the columns' units; None if only errors are known.
        first, now: (n, columns) predictions of the given model and of the present one, in the same units. If
            `measured` is None, they are errors.
        wrench: (n, 6) recorded force (N) and torque (N m), if the recording describes the sensor; else None.
        cameras: names of the cameras that took pictures.
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
    """A camera frame: the camera, its time in the track (s), and pictures (H, W, 3) uint8 by name."""

    camera: str
    time: float
    pictures: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Field:
    """A map of the model's error over one axis, in k cells.

    Attributes:
        edges: (k+1,) edges of the cells.
        first, now: (columns, k) RMS error of the given and of the present model, as a multiple of the noise.
        moment: (columns, k, 2) track and time (s) of the largest error in each cell; NaN in an empty cell.
        labels: (k,) names of the cells, if they are not ranges of a number.
    """

    edges: np.ndarray
    first: np.ndarray
    now: np.ndarray
    moment: np.ndarray
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Standing:
    """The state of a search.

    Attributes:
        joints: names of the joints in each posture.
        columns, units: names of the compared quantities, and the unit of each.
        shows: what the numbers in the maps mean.
        unit: unit of the errors.
        floor: RMS noise, in `unit`.
        ladder: the models so far, the given one first.
        effects: the added effects with their fitted sizes.
        initial: the effects of the given model.
        tracks: measured and predicted signals.
        maps: maps of the error, axis -> map; empty if the recordings show no torque.
        judged: whether there is a held-out recording; only then can effects be added.
        enough: whether the error is so near the noise that nothing more can be named.
        channels: the channels that the recordings have.
        channel: the channel that is compared.
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
    """A candidate: its members as `EFFECT:WHERE` joined by `+`, its name, and its expected share of the error."""

    key: str
    words: str
    share: float


@dataclass(frozen=True)
class Tried:
    """A fitted candidate: held-out RMS error before and after, and in `refused` why it did not pass ("" if it did)."""

    words: str
    size: str
    before: float
    after: float
    refused: str
