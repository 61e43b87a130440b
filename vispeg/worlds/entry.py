"""One entry of a world file's `effects`: an effect, a place, and numbers or distributions of its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from vispeg.core.effect import Effect, effect
from vispeg.core.errors import UserError
from vispeg.core.params import Param
from vispeg.worlds.distribution import Choice, Distribution, LogUniform, Normal, Uniform, parse, written
from vispeg.worlds.places import ALL, MANY, check
from vispeg.worlds.randomized import RandomizedEffect

KEYS = ("effect", "where", "params", "chance", "group", "rho", "source")
SERVO = "a servo's loop takes angles, and the arm of a world is sent torques"  # why an effect of a servo is refused


def ranged(entry: Any, model: Any, file: Path, key: str) -> RandomizedEffect:
    """Read an entry as a RandomizedEffect, and check every name, place, range and bound.

    A shape parameter called `seed` that is not stated is drawn from its whole range.

    Args:
        entry: from YAML.
        model: the Scene with the places.
        file, key: file and key of the entry, for errors.

    Raises:
        UserError: a wrong entry; it states file, key, value and choices.
    """
    if not isinstance(entry, Mapping):
        raise UserError("wrong entry", file=file, key=key, expected="a mapping with effect, where, params", got=entry)
    for name in entry:
        if name not in KEYS:
            raise UserError("unknown key", file=file, key=f"{key}.{name}", got=name, choices=KEYS)
    kind = effect(entry.get("effect"), file=file, key=f"{key}.effect")
    if of_servo(kind):
        raise UserError(f"{kind.name} would change nothing: {SERVO}", file=file, key=f"{key}.effect")
    entries = entry.get("params") or {}
    if not isinstance(entries, Mapping):
        raise UserError("wrong params", file=file, key=f"{key}.params", expected="a mapping", got=entries)
    params = {str(name): ranged_value(kind, name, raw, file, f"{key}.params.{name}") for name, raw in entries.items()}
    if not set(params) & set(kind.magnitudes):
        expected = f"one or more of {', '.join(kind.magnitudes)}"
        raise UserError(
            f"{kind.name} would change nothing", file=file, key=f"{key}.params", expected=expected, got=entries
        )
    seed = kind.params.get("seed")
    if seed is not None and seed.shape and "seed" not in params:
        params["seed"] = Uniform(seed.low, seed.high)
    group = entry.get("group", "")
    if not isinstance(group, str):
        raise UserError("wrong group", file=file, key=f"{key}.group", expected="a name", got=group)
    rho = _number(entry.get("rho", 0.0), -1.0, 1.0, file, f"{key}.rho")
    if rho and not group:
        raise UserError("a correlation needs a group", file=file, key=f"{key}.rho", expected="group: NAME", got=rho)
    return RandomizedEffect(
        kind.name,
        check(kind, entry.get("where", ALL), model, many=MANY, file=file, key=f"{key}.where"),
        params,
        source=str(entry.get("source", "")),
        group=group,
        rho=rho,
        chance=_number(entry.get("chance", 1.0), 0.0, 1.0, file, f"{key}.chance"),
    )


def of_servo(kind: Effect) -> bool:
    """Return whether an effect acts in a servo's loop alone, which no arm of a world has."""
    return kind.channels() == {"servo", "load"}


def entry_dict(r: RandomizedEffect) -> Mapping[str, object]:
    """Return a RandomizedEffect as an entry of a world file, for YAML and for hashing."""
    out: dict[str, object] = {"effect": r.effect, "where": r.where}
    out["params"] = {name: written(value) for name, value in r.params.items()}
    out |= {"chance": r.chance} if r.chance != 1.0 else {}
    out |= {"group": r.group, "rho": r.rho} if r.group else {}
    return out | ({"source": r.source} if r.source else {})


def within(value: float | Distribution, param: Param) -> bool:
    """Return whether all values that may be drawn are within the parameter's bounds.

    For a normal distribution only the mean is checked, because it is truncated at the bounds.
    """
    ends: tuple[float, ...]
    match value:
        case Uniform(low, high) | LogUniform(low, high):
            ends = (low, high)
        case Normal(mean):
            ends = (mean,)
        case Choice(values):
            ends = values
        case _:
            ends = (float(value),)
    return all(param.low <= x <= param.high for x in ends)


def ranged_value(kind: Effect, name: Any, raw: Any, file: str | Path, key: str) -> float | Distribution:
    """Read a parameter's number or distribution from a file's value, and check that it is within bounds.

    A normal distribution is truncated at the parameter's bounds.

    Raises:
        UserError: no such parameter, not a number or distribution, or values out of bounds; it names file and key.
    """
    param, value = kind.param(name, file=file, key=key), parse(raw, str(file), key)
    if not within(value, param):
        expected = f"{param.low:g} to {param.high:g} {param.unit}"
        raise UserError("out of bounds", file=file, key=key, expected=expected, got=raw)
    return replace(value, low=param.low, high=param.high) if isinstance(value, Normal) else value


def _number(value: Any, low: float, high: float, file: Path, key: str) -> float:
    """Return a file's value as a float. Raises UserError: not a finite number from `low` to `high`."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UserError("not a number", file=file, key=key, expected=f"{low:g} to {high:g}", got=value)
    if not low <= value <= high:
        raise UserError("out of bounds", file=file, key=key, expected=f"{low:g} to {high:g}", got=value)
    return float(value)
