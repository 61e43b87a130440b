"""The options of `vispeg record` and their checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from vispeg.api.inputs import Model
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.recordings.noise import NOISE
from vispeg.render.backends.backend import BackendName
from vispeg.robots.model import RobotModel
from vispeg.robots.scene import Scene
from vispeg.worlds.words import parse
from vispeg.worlds.world import World

LARGEST = 4096  # px, largest side of a picture


@dataclass(frozen=True)
class Asked:
    """The arguments of `record`, where they are documented."""

    model: Model
    motion: str
    duration: float | None = None
    rate_hz: float = 500.0
    control: Literal["position", "torque", "osc", "servo"] | None = None
    kp: Sequence[float] | None = None
    kd: Sequence[float] | None = None
    effects: Sequence[str | EffectInstance] = ()
    tool: str | None = None
    noise: Mapping[str, float] = field(default_factory=dict)
    force_limit: float | None = None
    torque_sensor: Literal["joint", "motor", "none"] = "joint"
    wrench_sensor: Literal["flange", "none"] = "flange"
    repeat: int = 1
    cameras: Sequence[str] = ()
    size: tuple[int, int] = (320, 240)
    fps: float = 3.0
    look: str | None = None
    backend: BackendName = "auto"
    seed: int = 0
    name: str = "simulated"

    @property
    def is_file(self) -> bool:
        """Whether the motion is read from a table file."""
        return bool(Path(self.motion).suffix)

    @property
    def levels(self) -> dict[str, float]:
        """Sensor noise by signal. Raises UserError: an unknown signal, or a level that is negative or infinite."""
        for name, level in self.noise.items():
            if name not in NOISE:
                raise UserError("unknown noise", key="--noise", got=name, choices=NOISE)
            if not 0 <= level < float("inf"):
                raise UserError("not a noise level", key=f"--noise {name}", expected="a number, 0 or more", got=level)
        return {**NOISE, **self.noise}

    def hidden(self, world: World, robot: RobotModel | Scene) -> World:
        """Return the world with `effects` added, which the simulated robot has and the recording does not state."""
        groups = ([e] if isinstance(e, EffectInstance) else parse(e, robot) for e in self.effects)
        return world.add(*(placed for group in groups for placed in group))

    def refuse(self, why: str, expected: str | None = None, **supported: tuple[object, ...]) -> None:
        """Raise UserError if an option has another value than those that this kind of motion supports."""
        for name, values in supported.items():
            if (value := getattr(self, name)) not in values:
                raise UserError(why, key=f"--{name.replace('_', '-')}", expected=expected, got=value)

    @property
    def pixels(self) -> tuple[int, int]:
        """Width and height of the pictures, px. Raises UserError: too small or too large."""
        if not all(16 <= side <= LARGEST for side in self.size):
            got, expected = "x".join(map(str, self.size)), f"WIDTHxHEIGHT, 16 to {LARGEST} px, as 320x240"
            raise UserError("not a size", key="--size", expected=expected, got=got)
        return self.size
