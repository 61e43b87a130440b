"""What identification found, as what training randomizes: fitted values are centres, intervals and a share widths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.worlds.distribution import Normal
from vispeg.worlds.measurement_file import is_measurement, load_measurement
from vispeg.worlds.model_file import load_model
from vispeg.worlds.randomized import RandomizedEffect

WIDTH = 2 * 1.96  # standard deviations in a 95 % interval
KEYS = ("file", "widen", "sd")


@dataclass(frozen=True)
class Identified:
    """A world file's `model`.

    Attributes:
        file: a `vispeg-model/1` or `vispeg-measurement/1` file.
        widen: share of a value's distance from null that is added to its standard deviation, for what the fit cannot
            know: a model's form, another day, another specimen.
        sd: how many of the fit's standard deviations are one of the draw's.
        explicit: whether `widen` is stated: if as 0, a constant is meant.
    """

    file: Path
    widen: float = 0.0
    sd: float = 1.0
    explicit: bool = False

    @classmethod
    def of(cls, stated: Any, world: Path) -> Identified:
        """From the value of the key `model` in the world file `world`: a path, or a mapping of these attributes.

        Raises:
            UserError: another type, an unknown key, or a number that cannot be; names file and key.
        """
        raw = {"file": stated} if isinstance(stated, str) else stated
        if not isinstance(raw, Mapping) or not isinstance(raw.get("file"), str):
            raise UserError("wrong model", file=world, key="model", expected="a file, or {file, widen, sd}", got=stated)
        for key in raw:
            if key not in KEYS:
                raise UserError("unknown key", file=world, key=f"model.{key}", got=key, choices=KEYS)
        numbers = {}
        for key, most in (("widen", 10.0), ("sd", 100.0)):
            value = raw.get(key, getattr(cls, key))
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= most:
                raise UserError("not a width", file=world, key=f"model.{key}", expected=f"0 to {most:g}", got=value)
            numbers[key] = float(value)
        file = Path(raw["file"]).expanduser()
        return cls(file if file.is_absolute() else world.parent / file, **numbers, explicit="widen" in raw)


def ranges_of(stated: Identified, robot: str) -> tuple[RandomizedEffect, ...]:
    """Return a range for each effect of a model: normal about the fitted value.

    The standard deviation is the root of (sd * that of the interval)^2 + (widen * distance from null)^2; a shape, which
    has no null, counts from 0. A value for which both are nothing is the same in every episode: its range's source says
    so, and a warning unless `widen: 0` means it.

    Args:
        stated: the file, and how wide.
        robot: the cell's arm.

    Raises:
        UserError: the file cannot be used, or is of another robot.
    """
    path = stated.file
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise UserError(
            "not a model file", file=path, expected="a .yaml file of the format vispeg-model/1 or vispeg-measurement/1"
        )
    if is_measurement(path):
        return _measured(stated, robot)
    model = load_model(path)
    if model.robot != robot:
        raise UserError("a model of another robot", file=path, key="robot", expected=robot, got=model.robot)
    return tuple(_ranged(placed, stated) for placed in model.effects)


def _measured(stated: Identified, robot: str) -> tuple[RandomizedEffect, ...]:
    """Return the effects that a measurement became."""
    path = stated.file
    measurement = load_measurement(path)
    if measurement.robot not in (None, robot):
        raise UserError("a measurement of another robot", file=path, key="robot", expected=robot, got=measurement.robot)
    if not measurement.effects:
        raise UserError("holds no effect", file=path, key="effects", expected="one or more")
    return tuple(_ranged(placed, stated) for placed in measurement.effects)


def without_interval(placed: EffectInstance) -> list[str]:
    """Parameters of an effect that nobody measured: no interval, and not the null of a magnitude that is not there."""
    params = effect(placed.effect).params
    sizes = [(v, params[name].null) for name, v in placed.params.items() if not params[name].shape]
    if all(v.low is None and v.value == null for v, null in sizes):
        return []
    bare = [name for name, v in placed.params.items() if v.low is None]
    return [name for name in bare if params[name].shape or placed.params[name].value != params[name].null]


def constant(placed: EffectInstance, names: Sequence[str]) -> str:
    """Return a sentence on values without an interval, and how to give them one."""
    return (
        f"{placed.label} has no interval for {', '.join(names)}: the same in every episode of a world; `low` and "
        "`high` in the file vary it, or `model: {file, widen: 0.3}` by a share of what is not 0"
    )


def _ranged(placed: EffectInstance, stated: Identified) -> RandomizedEffect:
    kind, params = effect(placed.effect), {}
    for name, v in placed.params.items():
        param = kind.params[name]
        fitted = 0.0 if v.low is None or v.high is None else (v.high - v.low) / WIDTH
        sd = float(np.hypot(stated.sd * fitted, stated.widen * abs(v.value - param.origin)))
        params[name] = Normal(v.value, sd, param.low, param.high) if sd > 0 else v.value
    source = f"identified: {stated.file.name}"
    fixed = [name for name in without_interval(placed) if not isinstance(params[name], Normal)]
    if fixed:
        source += f"; no interval, so constant: {', '.join(fixed)}"
        if not stated.explicit or stated.widen > 0:
            note(f"{stated.file}: {constant(placed, fixed)}")
    return RandomizedEffect(placed.effect, placed.where, params, source=source)
