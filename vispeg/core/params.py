"""A physical parameter: unit, bounds, and the value at which it vanishes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Param:
    """One parameter of an effect.

    Attributes:
        null: the value at which the effect vanishes, bit for bit.
        low, high: bounds of what is physically plausible; fits and samples stay inside.
        unit: SI unit, as text.
        start: a typical size, from which a fit starts and at which a signature is taken.
        shape: True for a parameter that only shapes the effect (a Stribeck velocity, a phase): it has no null of its
            own, and the effect vanishes whatever its value once the others are null.
        scale: how a fit and a uniform sample move through the range.
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
        """The value where the effect is not: null, or `start` for what only shapes it."""
        return self.start if self.shape else self.null

    @property
    def origin(self) -> float:
        """Zero point of the parameter's size: null, or 0 for a shape parameter."""
        return 0.0 if self.shape else self.null

    def __post_init__(self) -> None:
        if not self.low <= self.start <= self.high:
            raise ValueError(f"start {self.start} outside [{self.low}, {self.high}]")


@dataclass(frozen=True)
class Value:
    """A parameter's value with its 95 % interval where it was fitted."""

    value: float
    low: float | None = None
    high: float | None = None
