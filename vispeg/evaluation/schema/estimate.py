"""Records of numbers with intervals, and of worlds."""

from __future__ import annotations

from typing import TypedDict


class Interval(TypedDict):
    """An estimate, its 95 % interval, and the number n of episodes behind it; None for a number that is not finite."""

    value: float | None
    low: float | None
    high: float | None
    n: int


class WorldHash(TypedDict):
    """A world's name and hash; the hash is "" for a measured world, such as a robot's."""

    name: str
    hash: str
