"""Convert a measured number to a model's effect: its place, its values and their intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import vispeg.effects  # noqa: F401  (names must be enrolled)
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.worlds.measurement_file import Quantity

SCALES = {  # quantity -> effect whose parameter `scale` is the quantity divided by its nominal value
    "mass": "object_mass",
    "static_friction": "contact_friction",
    "kinetic_friction": "contact_friction",
    "stiffness": "contact_stiffness",
}


def scaled(quantity: Quantity, where: str, nominal: float) -> EffectInstance:
    """Return the effect that scales the model's nominal value to the measured one.

    Raises:
        UserError: no nominal value above 0, or a scale beyond the effect's bounds.
    """
    if not nominal > 0:
        raise UserError("no nominal value", key="--nominal", expected=f"above 0 {quantity.unit}", got=nominal)
    value = Value(quantity.value / nominal, quantity.low / nominal, quantity.high / nominal)
    return placed(SCALES[quantity.quantity], where, {"scale": value}, quantity)


def placed(name: str, where: str, values: Mapping[str, Value], quantity: Quantity) -> EffectInstance:
    """Return the effect with these values, and typical values of its other parameters.

    Intervals are cut at the effect's bounds.

    Raises:
        UserError: a value beyond the effect's bounds.
    """
    bounds = effect(name).params
    for key, value in values.items():
        param = bounds[key]
        if not param.low <= value.value <= param.high:
            expected = f"{param.low:g} to {param.high:g} {param.unit}"
            raise UserError(f"{name}: {key} is out of bounds", expected=expected, got=round(value.value, 6))
    bounded = {
        key: Value(
            v.value,
            None if v.low is None else max(v.low, bounds[key].low),
            None if v.high is None else min(v.high, bounds[key].high),
        )
        for key, v in values.items()
    }
    usual = EffectInstance.of(name, where)
    return EffectInstance(name, where, {**usual.params, **bounded}, {"measured": quantity.quantity})


def payload(results: Sequence[Quantity], mass: Quantity | None, axes: Sequence[str] = "xyz") -> EffectInstance:
    """Return a payload at the flange from a measured mass and, if there is one, its centre of mass.

    Args:
        results: of `vispeg measure mass` or `vispeg measure com`.
        mass: from another measurement, if the results have none.
        axes: the flange's axes along which com_x, com_y (and com_z) were measured.

    Raises:
        UserError: no mass, or a value beyond the effect's bounds.
    """
    by_name = {q.quantity: q for q in results}
    weight = by_name.get("mass", mass)
    if weight is None:
        raise UserError("a payload needs a mass", key="--mass", expected="the file of `vispeg measure mass`")
    values = {"mass": Value(weight.value, weight.low, weight.high)}
    for axis, name in zip(axes, ("com_x", "com_y", "com_z"), strict=False):
        if name in by_name:
            q = by_name[name]
            values[axis] = Value(q.value, q.low, q.high)
    return placed("payload", "flange", values, weight)
