"""What identification found, as what training randomizes: the fitted value is the centre, its interval the width."""

from __future__ import annotations

from pathlib import Path

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.worlds.distribution import Distribution, Normal
from vispeg.worlds.measurement_file import is_measurement, load_measurement
from vispeg.worlds.model_file import load_model
from vispeg.worlds.randomized import RandomizedEffect

WIDTH = 2 * 1.96  # standard deviations in a 95 % interval


def ranges_of(path: Path, robot: str) -> tuple[RandomizedEffect, ...]:
    """A range for each effect of a model file: normal where a value has an interval, fixed where it has none.

    Args:
        path: of the `vispeg-model/1` or `vispeg-measurement/1` file.
        robot: the cell's arm.

    Raises:
        UserError: the file cannot be used, or is of another robot.
    """
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise UserError(
            "not a model file", file=path, expected="a .yaml file of the format vispeg-model/1 or vispeg-measurement/1"
        )
    if is_measurement(path):
        return _measured(path, robot)
    model = load_model(path)
    if model.robot != robot:
        raise UserError("a model of another robot", file=path, key="robot", expected=robot, got=model.robot)
    return tuple(_ranged(placed, path) for placed in model.effects)


def _measured(path: Path, robot: str) -> tuple[RandomizedEffect, ...]:
    """The effects that a measurement became."""
    found = load_measurement(path)
    if found.robot not in (None, robot):
        raise UserError("a measurement of another robot", file=path, key="robot", expected=robot, got=found.robot)
    if not found.effects:
        raise UserError("has become no effect", file=path, key="effects", expected="one or more")
    return tuple(_ranged(placed, path) for placed in found.effects)


def _ranged(placed: EffectInstance, path: Path) -> RandomizedEffect:
    params: dict[str, float | Distribution] = {}
    for name, v in placed.params.items():
        bounds = effect(placed.effect).params[name]
        fitted = v.low is not None and v.high is not None and v.high > v.low
        sd = (v.high - v.low) / WIDTH if fitted else 0.0  # type: ignore[operator]
        params[name] = Normal(v.value, sd, bounds.low, bounds.high) if fitted else v.value
    return RandomizedEffect(placed.effect, placed.where, params, source=f"identified: {path.name}")
