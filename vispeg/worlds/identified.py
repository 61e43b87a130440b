"""Turn an identified model into ranges for training: normal distributions about the fitted values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.core.paths import expanded
from vispeg.robots.model import same
from vispeg.worlds.distribution import Normal
from vispeg.worlds.entry import SERVO, of_servo
from vispeg.worlds.measurement_file import is_measurement, load_measurement
from vispeg.worlds.model_file import load_model
from vispeg.worlds.randomized import RandomizedEffect

WIDTH = 2 * 1.96  # standard deviations in a 95 % interval
KEYS = ("file", "widen", "sd")


@dataclass(frozen=True)
class Identified:
    """The key `model` of a world file.

    Attributes:
        file: a `vispeg-model/1` or `vispeg-measurement/1` file.
        widen: share of a value's distance from null that is added to its standard deviation (in quadrature), for
            uncertainty that the fit does not contain: errors of the model, another day, another specimen.
        sd: factor from the fit's standard deviation to that of the draws.
        explicit: whether `widen` is stated; if it is stated as 0, values without an interval are meant to be constant.
    """

    file: Path
    widen: float = 0.0
    sd: float = 1.0
    explicit: bool = False

    @classmethod
    def of(cls, stated: Any, world: Path) -> Identified:
        """Read the value of the key `model`: a path, or a mapping with `file`, `widen` and `sd`.

        Args:
            stated: the value.
            world: the world file, to whose folder the path is relative.

        Raises:
            UserError: another type, an unknown key, or a number out of bounds; it names file and key.
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
        file = world.parent / expanded(raw["file"], world, "model.file")
        return cls(file, **numbers, explicit="widen" in raw)


def ranges_of(stated: Identified, robot: str) -> tuple[RandomizedEffect, ...]:
    """Return a range for each effect of a model: normal distributions about the fitted values.

    The standard deviation is sqrt((sd * that of the interval)^2 + (widen * distance from null)^2); for shape
    parameters, which have no null, the distance is from 0. If the standard deviation is 0, the value is the same in
    every episode. The range's source says so for values without an interval, and a note does too unless the file states
    `widen: 0`.

    Args:
        stated: the file and the widths.
        robot: name or path of the cell's arm.

    Raises:
        UserError: the file cannot be used, or belongs to another robot.
    """
    path = stated.file
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise UserError(
            "not a model file", file=path, expected="a .yaml file of the format vispeg-model/1 or vispeg-measurement/1"
        )
    if is_measurement(path):
        measurement = load_measurement(path)
        if not measurement.effects:
            raise UserError("holds no effect", file=path, key="effects", expected="one or more")
        placed = acting(measurement.effects, measurement.robot, robot, path)
    else:
        model = load_model(path)
        placed = acting(model.effects, model.robot, robot, path)
    return tuple(_ranged(one, stated) for one in placed)


def acting(
    effects: Sequence[EffectInstance], of: str | None, robot: str, file: str | Path
) -> tuple[EffectInstance, ...]:
    """Return the effects of a model or measurement file that act on an arm of a world.

    Effects of a servo's loop do not; a note names them.

    Args:
        effects: the file's effects.
        of: name or path of the file's robot; None if the effects fit any.
        robot: name or path of the world's arm.
        file: the file, for errors and the note.

    Raises:
        UserError: the file belongs to another robot.
    """
    if of is not None and not same(of, robot):
        raise UserError("of another robot", file=file, key="robot", expected=robot, got=of)
    servos = [placed.label for placed in effects if of_servo(effect(placed.effect))]
    if servos:
        note(f"{file}: {', '.join(servos)} left out: {SERVO}")
    return tuple(placed for placed in effects if placed.label not in servos)


def without_interval(placed: EffectInstance) -> list[str]:
    """List the parameters of an effect that have no interval, except magnitudes that are null.

    The list is empty if all magnitudes are null without an interval, because the effect is then absent.
    """
    params = effect(placed.effect).params
    magnitudes = [(v, params[name].null) for name, v in placed.params.items() if not params[name].shape]
    if all(v.low is None and v.value == null for v, null in magnitudes):
        return []
    bare = [name for name, v in placed.params.items() if v.low is None]
    return [name for name in bare if params[name].shape or placed.params[name].value != params[name].null]


def constant(placed: EffectInstance, names: Sequence[str]) -> str:
    """Return a sentence that says that these parameters have no interval, and how to vary them."""
    return (
        f"{placed.label} has no interval for {', '.join(names)}: the same in every episode of a world; `low` and "
        "`high` in the file vary it, or `model: {file, widen: 0.3}` by a share of what is not 0"
    )


def _ranged(placed: EffectInstance, stated: Identified) -> RandomizedEffect:
    """Return the range of one effect; see `ranges_of`."""
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
