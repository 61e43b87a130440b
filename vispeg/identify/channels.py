"""Items, the pieces of recordings that are compared, and their channels: measured values with their noise.

An item is one segment (an episode or a window of one) of a recording. A channel is one kind of measured value in it:
angles, torques, loads. (`vispeg.channels` uses the word for a whole kind of evidence.) The first channel of an item is
the principal one: its error, in its unit, is shown to the user. All channels enter the whitened residual.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vispeg.core.effect import Effect
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel
from vispeg.sim.segments.segment import Segment

UNITS = {
    "angle": "rad",
    "servo": "rad",
    "torque": "N m",
    "needed": "N m",
    "load": "of the log",  # whatever unit the servo reports
    "force": "N",
    "moment": "N m",
}


@dataclass(frozen=True)
class Channel:
    """One kind of measured value of an item, a column per joint, or per axis of a wrench.

    Attributes:
        kind: `angle` (under a known controller), `servo` (angle under a servo's own loop), `torque` (measured in
            either), `load` (a servo's own estimate of torque, of unknown gain), `needed` (measured torque, compared
            with inverse dynamics), `force` and `moment` (the wrench that keeps the hand on its measured path), or the
            name of a declared signal.
        measured: (m, nj) in the kind's unit.
        sigma: standard deviation of the noise, (nj,), or (m, nj) if it differs between samples.
        valid: (m, nj) bool, what is compared.
        stated: unit of a declared signal; empty for the other kinds.
    """

    kind: str
    measured: np.ndarray
    sigma: np.ndarray
    valid: np.ndarray
    stated: str = ""

    @property
    def unit(self) -> str:
        """Unit of the measured values."""
        return self.stated or UNITS[self.kind]


@dataclass(frozen=True)
class Item:
    """One segment of one recording, ready to be compared.

    Attributes:
        recording: the recording.
        segment: its samples, commands and controller.
        robot: the nominal robot with the declared tool and tilt.
        channels: what was measured, the principal channel first.
        widened: factor of each column's noise in the whitened residual, (nch,), 1 or more (`Evidence.weigh`).
    """

    recording: Recording
    segment: Segment
    robot: RobotModel
    channels: tuple[Channel, ...]
    widened: np.ndarray | float = 1.0

    @cached_property
    def measured(self) -> np.ndarray:
        """(m, nch) all channels side by side."""
        return np.concatenate([c.measured for c in self.channels], axis=1)

    @cached_property
    def sigma(self) -> np.ndarray:
        """Standard deviation of the noise, (nch,), or (m, nch) where it differs between samples."""
        return np.concatenate([c.sigma for c in self.channels], axis=-1)

    @property
    def scale(self) -> np.ndarray:
        """What its error is divided by, as `sigma`: the noise, widened where the model describes the item badly."""
        return self.sigma * self.widened

    @cached_property
    def valid(self) -> np.ndarray:
        """(m, nch) bool."""
        return np.concatenate([c.valid for c in self.channels], axis=1)

    @property
    def name(self) -> str:
        """Name of the recording; if only windows of it are used, also the time at which the item starts."""
        start = float(self.recording.elapsed[self.segment.rows[0]])
        return self.recording.name + (f", from {start:.4g} s" if self.recording.chosen else "")

    @property
    def nj(self) -> int:
        """Number of joints; of an arm's item the first nj columns are the principal channel."""
        return len(self.recording.joints)

    @property
    def posture(self) -> np.ndarray:
        """Joint angles at the samples, (m, nj) rad: the recording's, or the segment's if it has other samples."""
        rows = self.segment.rows
        return self.recording.q[rows] if len(rows) == len(self.valid) else self.segment.q

    @property
    def kind(self) -> str:
        """Kind of the principal channel."""
        return self.channels[0].kind

    @property
    def beside(self) -> str | None:
        """Kind of the second channel, such as `torque` or `load`; None if there is one channel alone."""
        return self.channels[1].kind if len(self.channels) > 1 else None

    @property
    def period(self) -> float:
        """Mean time between samples, s."""
        return float(self.segment.time[-1] / max(1, len(self.segment.time) - 1))


def shows(kind: Effect, channel: str) -> bool:
    """Return whether an effect is visible in a channel of this kind."""
    return channel in kind.channels()
