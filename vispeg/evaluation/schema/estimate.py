"""Numbers with intervals, and the world that they are of."""

from __future__ import annotations

from typing import TypedDict


class Interval(TypedDict):
    """An estimate, its 95 % interval and its number of episodes; None for numbers that are not finite."""

    value: float | None
    low: float | None
    high: float | None
    n: int


class WorldHash(TypedDict):
    """A world under its name; the hash is "" of a measured one."""

    name: str
    hash: str
