"""Distributions of parameters. A draw is the quantile `at(u)` of one number u in (0, 1), so draws can be correlated."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from statistics import NormalDist
from typing import Any

import numpy as np

from vispeg.core.errors import UserError


@dataclass(frozen=True)
class Uniform:
    """Uniform between `low` and `high`."""

    low: float
    high: float

    def __post_init__(self) -> None:
        _ordered(self.low, self.high)

    def at(self, u: float) -> float:
        """Return the quantile at u in (0, 1)."""
        return self.low + (self.high - self.low) * u


@dataclass(frozen=True)
class LogUniform:
    """Uniform in the logarithm between `low` > 0 and `high`."""

    low: float
    high: float

    def __post_init__(self) -> None:
        _ordered(self.low, self.high)
        if self.low <= 0:
            raise UserError("a log_uniform range must be above 0", got=self.low)

    def at(self, u: float) -> float:
        """Return the quantile at u in (0, 1)."""
        return float(np.exp(np.log(self.low) + (np.log(self.high) - np.log(self.low)) * u))


@dataclass(frozen=True)
class Normal:
    """Gaussian, truncated at `low` and `high` (and renormalised, so that values do not pile up there)."""

    mean: float
    sd: float
    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        _ordered(self.low, self.high)
        if not self.sd >= 0:
            raise UserError("a standard deviation below 0", got=self.sd)

    def at(self, u: float) -> float:
        """Return the quantile at u in (0, 1)."""
        if self.sd == 0:
            return min(max(self.mean, self.low), self.high)
        bell = NormalDist()
        a, b = bell.cdf((self.low - self.mean) / self.sd), bell.cdf((self.high - self.mean) / self.sd)
        inside = min(max(a + (b - a) * u, 1e-300), 1 - 1e-16)  # 0 and 1 have no finite quantile
        value = self.mean + self.sd * bell.inv_cdf(inside)
        return float(min(max(value, self.low), self.high))


@dataclass(frozen=True)
class Choice:
    """One of the values, all equally likely."""

    values: tuple[float, ...]

    def at(self, u: float) -> float:
        """Return the value at u in (0, 1)."""
        return self.values[min(int(u * len(self.values)), len(self.values) - 1)]


Distribution = Uniform | LogUniform | Normal | Choice
KINDS = ("uniform", "log_uniform", "normal", "choice")


def parse(raw: Any, file: str | None = None, key: str | None = None) -> float | Distribution:
    """Read a number or distribution from a file's value.

    Distributions are {uniform: [a, b]}, {log_uniform: [a, b]}, {normal: [mean, sd]} and {choice: [..]}.

    Raises:
        UserError: any other value, or an inverted range; it names file and key.
    """
    if _finite(raw):
        return float(raw)
    refused = partial(UserError, file=file, key=key)
    if not isinstance(raw, Mapping) or len(raw) != 1:
        raise refused("not a value", expected="a number or a distribution", got=raw, choices=KINDS)
    ((kind, values),) = raw.items()
    if kind not in KINDS:
        raise refused("unknown distribution", got=kind, choices=KINDS)
    numbers: list[Any] = list(values) if isinstance(values, (list, tuple)) else [None]  # None is refused
    if not numbers or not all(map(_finite, numbers)) or (kind != "choice" and len(numbers) != 2):
        expected = "numbers" if kind == "choice" else "two numbers"
        raise refused(f"{kind} takes {expected}", got=values)
    try:
        if kind == "choice":
            return Choice(tuple(map(float, numbers)))
        cls = {"uniform": Uniform, "log_uniform": LogUniform, "normal": Normal}[kind]
        return cls(float(numbers[0]), float(numbers[1]))
    except UserError as error:
        raise refused(str(error)) from error


def written(value: float | Distribution) -> Any:
    """Return a number or distribution as a value for YAML, the inverse of `parse`."""
    if isinstance(value, Uniform):
        return {"uniform": [value.low, value.high]}
    if isinstance(value, LogUniform):
        return {"log_uniform": [value.low, value.high]}
    if isinstance(value, Normal):
        return {"normal": [value.mean, value.sd]}
    if isinstance(value, Choice):
        return {"choice": list(value.values)}
    return float(value)


def _finite(raw: Any) -> bool:
    """Return whether a file's value is a number that a float can hold; an integer may have any number of digits."""
    return isinstance(raw, (int, float)) and not isinstance(raw, bool) and abs(raw) <= sys.float_info.max


def _ordered(low: float, high: float) -> None:
    if not low <= high:
        raise UserError("an inverted range", expected="low <= high", got=f"[{low}, {high}]")
