"""The interface of a robot to the run loop: four methods. Any class of your own with these is a driver.

The robot itself holds the commanded flange pose, also between calls, with the control law and gains that the policy was
trained with (`interface.controller`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from vispeg.interface.builder import Picture
from vispeg.interface.interface import Interface
from vispeg.recordings.cell import WrenchSensor


@dataclass(frozen=True, eq=False)
class Reading:
    """The robot's measurements at one moment.

    Attributes:
        time: s, on the robot's own clock, which may differ from the host's.
        q, dq: (nj,) rad, rad/s.
        wrench: (6,) N and N m, in the convention of `Connected.wrench`; None if the robot measures none.
        pictures: camera name -> picture, for the requested cameras.
    """

    time: float
    q: np.ndarray
    dq: np.ndarray
    wrench: np.ndarray | None
    pictures: Mapping[str, Picture] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Connected:
    """What a driver states about its robot when an episode begins.

    Attributes:
        wrench: convention of the wrench; by default of the tool on the flange, in flange axes, raw. None if the robot
            measures none: then no force limit can act, and policies that observe the wrench cannot run.
        start: what is known about the episode's start besides the joints: `goal_m`, `believed_m`, `effects`, as in
            trial.yaml.
        world: name and hash of a simulated robot's world.
    """

    wrench: WrenchSensor | None = WrenchSensor(acts_on="flange")
    start: Mapping[str, Any] = field(default_factory=dict)
    world: Mapping[str, str] = field(default_factory=dict)


class Driver(Protocol):
    """A robot.

    One that judges the task itself may also have `ended() -> bool`, called in every policy period after `read`: whether
    the episode has ended, of which `stop` then tells. Without it the measured place of the tip decides.
    """

    def connect(self, interface: Interface, seed: int) -> Connected | None:
        """Begin an episode: the robot holds its current pose. `seed` is the episode's number."""
        ...

    def read(self, cameras: Sequence[str] = ()) -> Reading:
        """Return the newest reading, with pictures of these cameras. Called once per control period; must not block.

        Raises EOFError if no more readings will come, as at the end of a log; the episode then ends as a timeout.
        """
        ...

    def command(self, pose: np.ndarray) -> None:
        """Hold the flange at this pose (7,) from now on: m, then w x y z, in the base."""
        ...

    def stop(self) -> Mapping[str, Any] | None:
        """Come to rest and hold; may be called from another thread while `read` waits.

        Returns:
            How the episode ended where the robot knows: `success`, `category` and, if known, `peak_force_n`, `depth_m`.
        """
        ...
