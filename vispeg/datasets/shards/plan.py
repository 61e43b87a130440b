"""A rendering job divided into shards, each determined only by the plan and the shard's number."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.seeds import check_seed, stream

RGBD, RGB = "rgbd", "rgb"
# most frames and bytes of a shard; its last episode is cut off, so smaller shards waste more simulation
SHARD_FRAMES, SHARD_BYTES = 500, 48_000_000


@dataclass(frozen=True)
class Plan:
    """Everything, together with versions of packages, that determines the bytes of a dataset.

    Attributes:
        world: a world's name or the path of its file.
        world_hash: hash of the world's content.
        frames: total number of frames; a frame is one moment in one look, seen by all cameras.
        looks: number of looks of every physical episode.
        cameras: names of the cameras.
        size: shorter side of a picture, px; 0 for the cameras' own size.
        seed: seed of everything random.
        noise: standard deviation of the noise on the expert's actions, as a share of the largest action; with noise,
            the data show how to recover from errors.
        labels: whether label pictures of parts are made.
        backend: the renderer, unless the world names one.
        shard_frames: number of frames of the largest shard.
        modality: `rgbd`, or `rgb` for pictures without depth.
        images: digest of the images that looks draw from (see `vispeg.effects.common.images`); empty if none does.
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
    images: str = ""

    def __post_init__(self) -> None:
        for key in ("frames", "looks", "shard_frames"):
            if getattr(self, key) < 1:
                raise UserError("must be at least 1", key=key, got=getattr(self, key))
        if self.size and not 8 <= self.size <= 4096:
            raise UserError("not a picture's size", key="size", expected="8 to 4096 px", got=self.size)
        if not 0 <= self.noise <= 1:
            raise UserError("not a share of the largest action", key="noise", expected="0 to 1", got=self.noise)
        if self.modality not in (RGBD, RGB):
            raise UserError("no such pictures", key="modality", got=self.modality, choices=(RGBD, RGB))
        check_seed(self.seed, "seed")

    @property
    def shards(self) -> tuple[Shard, ...]:
        """All shards, of nearly the same size."""
        count = math.ceil(self.frames / self.shard_frames)
        ends = [self.frames * i // count for i in range(count + 1)]
        return tuple(Shard(i, a, b - a) for i, (a, b) in enumerate(zip(ends, ends[1:], strict=False)))

    def episode_seed(self, shard: int, number: int) -> int:
        """Return the seed of a shard's physical episode by number, below 2^31."""
        return int(stream(self.seed, "dataset", shard, number).integers(2**31))

    def to_json(self) -> Mapping[str, object]:
        """Return the plan as JSON values."""
        return {**asdict(self), "cameras": list(self.cameras)}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Plan:
        """Read a plan from JSON values. Raises UserError: not a plan."""
        if set(values) != {f.name for f in fields(cls)}:
            raise UserError("not a plan of a rendering", got=sorted(values))
        return cls(**{**values, "cameras": tuple(values["cameras"])})


@dataclass(frozen=True)
class Shard:
    """A piece of a dataset: its number, the index of its first frame, and its number of frames."""

    number: int
    first: int
    frames: int


def look_seed(seed: int, look: int) -> int:
    """Return the seed of an episode's look by number; look 0 has the episode's own seed."""
    return seed if look == 0 else int(stream(seed, "dataset-look", look).integers(2**31))


def shard_frames(pixels: int) -> int:
    """Return the number of frames of a shard that fits a worker's memory.

    Args:
        pixels: number of pixels of a frame, of all cameras together.
    """
    return int(np.clip(SHARD_BYTES // (8 * pixels), 8, SHARD_FRAMES))  # bytes a pixel: colour 3, depth 4, part 1
