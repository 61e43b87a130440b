"""A parameter of an effect: unit, bounds, and the value at which the effect vanishes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Param:
    """One parameter of an effect.

    Attributes:
        null: the value at which the effect vanishes, bit for bit.
        low, high: physically plausible bounds; fits and samples stay within them.
        unit: SI unit, as text.
        start: a typical value, from which fits start.
        shape: True for a parameter that only shapes the effect (a Stribeck velocity, a phase): it has no null of its
            own, and the effect vanishes if the other parameters are null, for any value of this one.
        scale: whether fits and uniform samples move through the range by differences (linear) or ratios (log).
        doc: one line for `vispeg effects`.
    """

    null: float
    low: float
    high: float
    unit: str
    start: float
    shape: bool = False
    scale: Literal["linear", "log"] = "linear"
    doc: str = ""

    @property
    def absent(self) -> float:
        """The value if the effect is absent: null, or `start` for a shape parameter."""
        return self.start if self.shape else self.null

    @property
    def origin(self) -> float:
        """The value from which the parameter's size is counted: null, or 0 for a shape parameter."""
        return 0.0 if self.shape else self.null

    def __post_init__(self) -> None:
        if not self.low <= self.start <= self.high:
            raise ValueError(f"start {self.start} outside [{self.low}, {self.high}]")


def seed_param(doc: str, start: float = 0.0) -> Param:
    """Return a shape parameter that seeds an effect's random choices, so that a sampled world can be replayed.

    It is rounded down to a whole number.
    """
    return Param(0.0, 0.0, 2.0**31 - 1, "1", start=start, shape=True, doc=doc)


@dataclass(frozen=True)
class Value:
    """A parameter's value, with its 95 % interval `low` to `high` if it was fitted or measured."""

    value: float
    low: float | None = None
    high: float | None = None
