"""Convert a measured number to a model's effect: its place, its values and their intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import vispeg.effects  # noqa: F401  # names must be enrolled
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.measure.uncertainty import Input, propagate, stated
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


def undeclared(results: Sequence[Quantity], tool: tuple[float, np.ndarray], rng: np.random.Generator) -> list[Quantity]:
    """Return mass, com_x, com_y and com_z of what a flange carries beside the declared tool.

    Args:
        results: the same numbers of everything that the flange carries.
        tool: the tool's mass, kg, and centre of mass (3,), m, flange frame.
        rng: of the Monte Carlo propagation.

    Raises:
        UserError: the measured mass is that of the tool.
    """
    by_name = {q.quantity: q for q in results}
    mass, (known, centre) = by_name["mass"], tool
    if mass.low <= known <= mass.high:
        expected, got = f"another mass than {known:g} kg", f"{mass.low:g} to {mass.high:g} kg"
        raise UserError("the flange carries the declared tool alone", expected=expected, got=got)
    weighed = _input(mass)
    rest = [propagate("mass", mass.unit, lambda m: m - known, [weighed], rng, repeats=mass.repeats)]
    for name, at in zip(("com_x", "com_y", "com_z"), centre, strict=True):
        q = by_name[name]

        def without_tool(m: Any, c: Any, at: float = at) -> Any:
            return (m * c - known * at) / (m - known)

        rest.append(propagate(name, q.unit, without_tool, [weighed, _input(q)], rng, repeats=q.repeats))
    return rest


def _input(q: Quantity) -> Input:
    return stated(q.quantity, q.u, q.value, np.inf if q.dof is None else q.dof)


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
