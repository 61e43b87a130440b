"""A camera's pipeline: the image effects of sampled worlds, in their order, on a stack of images of one camera."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import groupby
from typing import Any

import numpy as np

import vispeg.effects  # noqa: F401  (enrols the library)
from vispeg.core.effect import Effect, effect
from vispeg.core.errors import UserError
from vispeg.core.frame import Frame
from vispeg.core.world import World
from vispeg.effects._light import LightEffect, pass_light


@dataclass
class Stage:
    """One effect of the pipeline: its parameters (n,) by name, null where an image is without it, and its memory."""

    effect: Effect
    p: dict[str, np.ndarray]
    state: dict[str, Any] = field(default_factory=dict)


class Pipeline:
    """What a camera makes of rendered images: row i of a stack goes through the effects of world i.

    An image's result depends on its own world and generator only, not on what else is in the stack; each effect draws
    from a stream of its own, so that one more leaves the others' draws as they were.

    Args:
        worlds: sampled worlds, one an image of the stack.
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
        """Gives some rows new worlds, as when their episodes begin anew; what effects remembered of them is forgotten.

        Raises:
            UserError: a world still has ranges to be drawn.
        """
        for row, world in zip(rows, worlds, strict=True):
            if world.ranges:
                raise UserError("a pipeline takes a sampled world", got=world.ranges[0].label)
            for stage in self._stages.values():
                for name, param in stage.effect.params.items():
                    stage.p[name][row] = param.start if param.shape else param.null
                if "time" in stage.state:
                    stage.state["time"][row] = np.inf  # no time goes on from there: the row begins anew
            for placed in world.effects:
                kind = effect(placed.effect)
                if kind.kind != "camera" or not kind.overrides("image") or placed.where not in ("all", self.camera):
                    continue
                stage = self._stages.setdefault(kind.name, self._stage(kind))
                for name, value in placed.params.items():
                    stage.p[name][row] = value.value
        self._stages = {name: s for name, s in self._stages.items() if self._at_work(s)}

    def run(self, frame: Frame, rng: Sequence[np.random.Generator]) -> Frame:
        """The images as the camera delivers them; `frame` stays as it is.

        Args:
            frame: as rendered, one image a row. Where it has depth but no truth, its depth is the truth.
            rng: one generator an image; each gives one number a call.

        Raises:
            ValueError: not one image and one generator for each world.
        """
        if frame.n != self.n or len(rng) != self.n:
            raise ValueError(f"{self.n} worlds, {frame.n} images, {len(rng)} generators")
        keys = [int(g.integers(2**63)) for g in rng]
        out = replace(
            frame,
            rgb=None if frame.rgb is None else frame.rgb.copy(),
            depth=None if frame.depth is None else frame.depth.copy(),
            truth=frame.depth if frame.truth is None else frame.truth,
        )
        for in_light, group in groupby(self.stages, lambda s: isinstance(s.effect, LightEffect)):
            if in_light:
                pass_light([(s.effect, s.p, Streams(keys, s.effect.name)) for s in group], out)  # type: ignore[misc]
                continue
            for stage in group:
                stage.effect.image(stage.state, out, stage.p, Streams(keys, stage.effect.name))
        return replace(out, truth=frame.truth)

    def _stage(self, kind: Effect) -> Stage:
        start = {k: np.full(self.n, q.start if q.shape else q.null) for k, q in kind.params.items()}
        return Stage(kind, start)

    @staticmethod
    def _at_work(stage: Stage) -> bool:
        return any(np.any(stage.p[k] != stage.effect.params[k].null) for k in stage.effect.magnitudes)


class Streams(Sequence[np.random.Generator]):
    """One generator an image for one effect, made when it is asked for and then kept."""

    def __init__(self, keys: Sequence[int], name: str):
        self._keys, self._name = keys, _word(name)
        self._made: dict[int, np.random.Generator] = {}

    def __len__(self) -> int:
        return len(self._keys)

    def __getitem__(self, row: Any) -> np.random.Generator:
        row = int(row)
        if row not in self._made:
            # a counter-based generator takes (key, name) as they are: no seeding to pay for at every frame
            self._made[row] = np.random.Generator(np.random.Philox(key=[self._keys[row], self._name]))
        return self._made[row]


@lru_cache(maxsize=256)
def _word(name: str) -> int:
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
