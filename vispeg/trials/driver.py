"""What the run loop needs of a robot: four calls. A class of your own with these is a driver.

The robot holds a commanded flange pose by itself, with the law and gains that the policy was trained with
(`interface.controller`), and goes on doing so between calls.
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
    """What the robot measures at one moment.

    Attributes:
        time: s, on the robot's own clock, which need not be ours.
        q, dq: (nj,) rad, rad/s.
        wrench: (6,) N and N m, as `Connected.wrench` says that it is to be read; None of a robot that measures none.
        pictures: of the cameras that were asked for, by name.
    """

    time: float
    q: np.ndarray
    dq: np.ndarray
    wrench: np.ndarray | None
    pictures: Mapping[str, Picture] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Connected:
    """What a driver says of its robot as an episode begins.

    Attributes:
        wrench: how the wrench is to be read; by default what the tool puts on the flange, in the flange's axes, raw.
            None: the robot measures none, so that no limit of force can act and no policy that is told it can run.
        start: what is known of the episode's start beside the joints: `goal_m`, `believed_m`, `effects`, as trial.yaml
            has them.
        world: name and hash of a simulated robot's world.
    """

    wrench: WrenchSensor | None = WrenchSensor(acts_on="flange")
    start: Mapping[str, Any] = field(default_factory=dict)
    world: Mapping[str, str] = field(default_factory=dict)


class Driver(Protocol):
    """A robot."""

    def connect(self, interface: Interface, seed: int) -> Connected | None:
        """Note that an episode begins: the robot holds the pose that it is in. `seed` numbers the episodes."""
        ...

    def read(self, cameras: Sequence[str] = ()) -> Reading:
        """Give the newest reading, with pictures of these cameras. Called once a control period: returns at once.

        Raises EOFError where there will be no more, as at the end of a log: the episode has taken its time.
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
