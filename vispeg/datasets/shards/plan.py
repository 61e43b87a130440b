"""A rendering job cut into shards, each determined by the plan and the shard's number alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream

RGBD, RGB = "rgbd", "rgb"
SHARD_FRAMES, SHARD_BYTES = 500, 48_000_000  # at most, for one shard; of smaller ones physics wastes more at the end


@dataclass(frozen=True)
class Plan:
    """Everything that the bytes of a dataset follow from, with the versions of the packages.

    Attributes:
        world: a world's name or the path of its file.
        world_hash: of what that world says.
        frames: in all; a frame is one moment in one look, seen by all cameras.
        looks: looks of every physical episode.
        cameras: names.
        size: px of a picture's shorter side, 0 for the cameras' own.
        seed: of everything.
        noise: standard deviation of what is added to the expert's actions, so that it shows how to come back.
        labels: whether pictures of parts are made too.
        backend: of the renderer; the world's own where it names one.
        shard_frames: frames of the largest shard.
        modality: `rgbd`, or `rgb` for pictures without depth.
    """

    world: str
    world_hash: str
    frames: int
    looks: int = 1
    cameras: tuple[str, ...] = ()
    size: int = 0
    seed: int = 0
    noise: float = 0.2
    labels: bool = True
    backend: str = "auto"
    shard_frames: int = SHARD_FRAMES
    modality: str = RGBD

    def __post_init__(self) -> None:
        for key in ("frames", "looks", "shard_frames"):
            if getattr(self, key) < 1:
                raise UserError("must be at least 1", key=key, got=getattr(self, key))
        if self.size and not 8 <= self.size <= 4096:
            raise UserError("not a picture's size", key="size", expected="8 to 4096 px", got=self.size)
        if not 0 <= self.noise <= 1:
            raise UserError("not a share of the greatest action", key="noise", expected="0 to 1", got=self.noise)
        if self.modality not in (RGBD, RGB):
            raise UserError("no such pictures", key="modality", got=self.modality, choices=(RGBD, RGB))
        if self.seed < 0:
            raise UserError("not a seed", key="seed", expected="0 or more", got=self.seed)

    @property
    def shards(self) -> tuple[Shard, ...]:
        """All shards, of nearly the same size."""
        count = math.ceil(self.frames / self.shard_frames)
        ends = [self.frames * i // count for i in range(count + 1)]
        return tuple(Shard(i, a, b - a) for i, (a, b) in enumerate(zip(ends, ends[1:], strict=False)))

    def episode_seed(self, shard: int, number: int) -> int:
        """Seed of the `number`-th physical episode of a shard, below 2^31."""
        return int(stream(self.seed, "dataset", shard, number).integers(2**31))

    def to_json(self) -> Mapping[str, object]:
        """As JSON values."""
        return {**asdict(self), "cameras": list(self.cameras)}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Plan:
        """From JSON values. Raises UserError for what is no plan."""
        if set(values) != {f.name for f in fields(cls)}:
            raise UserError("not a plan of a rendering", got=sorted(values))
        return cls(**{**values, "cameras": tuple(values["cameras"])})


@dataclass(frozen=True)
class Shard:
    """A piece of a dataset: its number, its first frame's index, how many frames."""

    number: int
    first: int
    frames: int


def look_seed(seed: int, look: int) -> int:
    """Seed of an episode's `look`-th look; the first one's is the episode's own, as when it is played."""
    return seed if look == 0 else int(stream(seed, "dataset-look", look).integers(2**31))


def shard_frames(pixels: int) -> int:
    """Frames of a shard, so that it fits a worker's memory.

    Args:
        pixels: of one frame, all cameras together.
    """
    return int(np.clip(SHARD_BYTES // (8 * pixels), 8, SHARD_FRAMES))
