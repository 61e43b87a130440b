"""What the run loop needs of a robot: four calls. A class of your own with these is a driver.

The robot holds a commanded flange pose by itself, with the law and gains that the policy was trained with
(`interface.controller`), and goes on doing so between calls.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from vispeg.core.errors import UserError
from vispeg.interface.builder import Picture
from vispeg.interface.interface import Interface
from vispeg.recordings.cell import WrenchSensor

CALLS = ("connect", "read", "command", "stop")
SIMULATED, PYTHON = "sim", "python"


@dataclass(frozen=True, eq=False)
class Reading:
    """What the robot measures at one moment.

    Attributes:
        time: s, on the robot's own clock, which need not be ours.
        q, dq: (nj,) rad, rad/s.
        wrench: (6,) N and N m, as `Connected.wrench` says that it is to be read.
        pictures: of the cameras that were asked for, by name.
    """

    time: float
    q: np.ndarray
    dq: np.ndarray
    wrench: np.ndarray
    pictures: Mapping[str, Picture] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Connected:
    """What a driver says of its robot as an episode begins.

    Attributes:
        wrench: how the wrench is to be read; by default what the tool puts on the flange, in the flange's axes, raw.
        start: what is known of the episode's start beside the joints: `goal_m`, `believed_m`, `effects`, as trial.yaml
            has them.
        world: name and hash of a simulated robot's world.
    """

    wrench: WrenchSensor = WrenchSensor(acts_on="flange")
    start: Mapping[str, Any] = field(default_factory=dict)
    world: Mapping[str, str] = field(default_factory=dict)


class Driver(Protocol):
    """A robot."""

    def connect(self, interface: Interface, seed: int) -> Connected | None:
        """An episode is about to begin: the robot holds the pose that it is in. `seed` numbers the episodes."""
        ...

    def read(self, cameras: Sequence[str] = ()) -> Reading:
        """The newest reading, with pictures of these cameras. Called once a control period: returns at once."""
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


def driver(text: str) -> Driver:
    """The driver that `--robot` names: `sim:WORLD`, or `python:MODULE:CALLABLE`.

    Raises:
        UserError: no such kind, module or world, or an object without the four calls.
    """
    kind, _, rest = text.partition(":")
    if kind == SIMULATED and rest:
        from vispeg.trials.socket_robot import SocketRobot

        return SocketRobot(rest)
    if kind == PYTHON and rest.count(":") == 1:
        return _imported(text, *rest.split(":"))
    expected = f"{SIMULATED}:WORLD, or {PYTHON}:MODULE:CALLABLE"
    raise UserError("no such robot", key="--robot", expected=expected, got=text)


def _imported(text: str, module: str, name: str) -> Any:
    try:
        target = getattr(importlib.import_module(module), name)()
    except UserError:
        raise
    except Exception as error:  # a module may raise anything while it is imported, a driver as it is made
        what = (str(error).splitlines() or [""])[0]
        expected = "a callable without arguments, in a module on PYTHONPATH or installed"
        raise UserError(
            f"no such driver ({type(error).__name__}: {what})", key="--robot", expected=expected, got=text
        ) from error
    lacking = [call for call in CALLS if not callable(getattr(target, call, None))]
    if lacking:
        raise UserError(f"a driver without {', '.join(lacking)}", key="--robot", expected=", ".join(CALLS), got=text)
    return target
