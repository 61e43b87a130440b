"""The sensor pipeline of a camera: apply the image effects of sampled worlds, in order, to a stack of images."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

import numpy as np

from vispeg.core.effect import Effect, effect
from vispeg.core.frame import Frame
from vispeg.effects.common.light import LightEffect, pass_light
from vispeg.worlds.world import World


@dataclass
class Stage:
    """One effect of the pipeline.

    Attributes:
        effect: the effect.
        p: by name, a parameter's values (n,), one per image; its null value for images without the effect.
        streams: the effect's random generators, one per image.
        state: what the effect remembers from frame to frame.
    """

    effect: Effect
    p: dict[str, np.ndarray]
    streams: Streams
    state: dict[str, Any] = field(default_factory=dict)

    def at(self, rows: np.ndarray | None) -> dict[str, np.ndarray]:
        """Return the parameters, set to null outside the given rows (n,) bool; None keeps all rows."""
        if rows is None:
            return self.p
        null = {k: np.where(rows, self.p[k], self.effect.params[k].null) for k in self.effect.magnitudes}
        return {**self.p, **null}


class Pipeline:
    """Sensor pipeline of a camera: image i of a stack passes through the effects of world i.

    An image's result depends on its own world and generator only, not on what else is in the stack; each effect draws
    from its own random stream, so that adding an effect does not change the draws of others.

    Args:
        worlds: sampled worlds, one per image of the stack.
        camera: the camera's name; effects at `all` act on every camera.
    """

    def __init__(self, worlds: Sequence[World], camera: str):
        self.camera, self.n = camera, len(worlds)
        self._stages: dict[str, Stage] = {}
        self.place(range(self.n), worlds)

    @property
    def stages(self) -> list[Stage]:
        """Stages in the order in which they act."""
        return sorted(self._stages.values(), key=lambda s: (s.effect.order, s.effect.name))

    def place(self, rows: Sequence[int], worlds: Sequence[World]) -> None:
        """Assign new worlds to some rows, as at a reset; the effects' state of these rows is cleared."""
        for row, world in zip(rows, worlds, strict=True):
            for stage in self._stages.values():
                for name, param in stage.effect.params.items():
                    stage.p[name][row] = param.absent
                if "time" in stage.state:
                    # no later time is reached, so the effect sees time go back and resets
                    stage.state["time"][row] = np.inf
            for placed in world.effects:
                kind = effect(placed.effect)
                if kind.family != "camera" or not kind.overrides("image") or placed.where not in ("all", self.camera):
                    continue
                stage = self._stages.setdefault(kind.name, self._stage(kind))
                for name, value in placed.params.items():
                    stage.p[name][row] = value.value
        self._stages = {name: s for name, s in self._stages.items() if self._acts(s)}

    def run(self, frame: Frame, rng: Sequence[np.random.Generator], rows: np.ndarray | None = None) -> Frame:
        """Return the images as the camera delivers them; `frame` is not modified.

        Args:
            frame: rendered images, one per row. Without `truth` and `colour`, its depth and rgb are taken for them.
            rng: one generator per image; each call draws one number from each of them.
            rows: (n,) bool, images to process; the others stay as rendered and leave the effects' state unchanged.
                None for all.

        Raises:
            ValueError: the number of images or of generators differs from the number of worlds.
        """
        if frame.n != self.n or len(rng) != self.n:
            raise ValueError(f"{self.n} worlds, {frame.n} images, {len(rng)} generators")
        keys = [int(g.integers(2**63)) for g in rng]
        out = replace(
            frame,
            rgb=None if frame.rgb is None else frame.rgb.copy(),
            depth=None if frame.depth is None else frame.depth.copy(),
            parts=None if frame.parts is None else frame.parts.copy(),
            truth=frame.depth if frame.truth is None else frame.truth,
            colour=frame.rgb if frame.colour is None else frame.colour,
            shown=np.array(np.broadcast_to(frame.time, (self.n,)), float),
        )
        for in_light, group in groupby(self.stages, lambda s: isinstance(s.effect, LightEffect)):
            if in_light:
                pass_light([(s.effect, s.at(rows), s.streams.begin(keys)) for s in group], out)  # type: ignore[misc]  # grouped by their type
                continue
            for stage in group:
                stage.effect.image(stage.state, out, stage.at(rows), stage.streams.begin(keys))
        return replace(out, truth=frame.truth, colour=frame.colour)

    def _stage(self, kind: Effect) -> Stage:
        return Stage(kind, kind.absent((self.n,)), Streams(kind.name, self.n))

    @staticmethod
    def _acts(stage: Stage) -> bool:
        """Return whether any image has the effect with a magnitude other than null."""
        return any(np.any(stage.p[k] != stage.effect.params[k].null) for k in stage.effect.magnitudes)


class Streams(Sequence[np.random.Generator]):
    """Random generators of one effect, one per image, seeded in each frame by the image's key and the effect's name.

    They are SFC64 generators (Doty-Humphrey's PractRand). Each is reseeded in place: its state is set and the first 16
    numbers are discarded. This takes a tenth of the time of constructing a new one.
    """

    def __init__(self, name: str, n: int):
        self._name = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
        self._keys: list[int] = []
        self._made: list[np.random.Generator | None] = [None] * n
        self._started: list[bool] = [False] * n

    def begin(self, keys: Sequence[int]) -> Streams:
        """Seed the streams of a frame with one number below 2^63 per image."""
        self._keys, self._started = list(keys), [False] * len(keys)
        return self

    def __len__(self) -> int:
        return len(self._made)

    def __getitem__(self, row: Any) -> Any:
        generator = self._made[row]
        if generator is None:
            generator = self._made[row] = np.random.Generator(np.random.SFC64(0))
        if not self._started[row]:
            words = np.array([self._keys[row], self._name, 0, 1], np.uint64)
            generator.bit_generator.state = {
                "bit_generator": "SFC64",
                "state": {"state": words},
                "has_uint32": 0,
                "uinteger": 0,
            }
            generator.bit_generator.random_raw(16, output=False)
            self._started[row] = True
        return generator
