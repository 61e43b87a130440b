"""Read effects from a command line: `coulomb_friction:joint4:torque=1.2`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from vispeg.core.effect import Effect, EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.worlds.places import ALL, EACH, MANY, check, instances


def place(kind: Effect, where: str, robot: Any) -> str:
    """Check that an effect can act at `where` on a robot (a RobotModel or Scene), and return the place.

    `all` and `all-joints` mean every place; they become the place's name if there is only one.

    Raises:
        UserError: no such place; it lists the choices.
    """
    where = check(kind, ALL if where == "all-joints" else where, robot)
    targets = kind.targets(robot)
    return targets[0] if where == ALL and len(targets) == 1 else where


def values(kind: Effect, pairs: Iterable[str]) -> dict[str, float]:
    """Read parameter values from texts `name=number`.

    Raises:
        UserError: another form, an unknown parameter, or a number out of bounds.
    """
    out: dict[str, float] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals:
            raise UserError("not a parameter setting", expected="name=number", got=pair, choices=kind.params)
        param = kind.param(name)
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not param.low <= number <= param.high:  # NaN is refused too
            expected = f"a number from {param.low:g} to {param.high:g} {param.unit}"
            raise UserError(f"{kind.name}: {name} is out of bounds", expected=expected, got=text)
        out[name] = number
    return out


def completed(kind: Effect, stated: dict[str, float]) -> dict[str, float]:
    """Return the values of all parameters of an effect, of which only some are stated.

    If no magnitude is stated, all have typical values (`start`). If one is stated, the others are null: a camera that
    is stated to be 4 mm off to the right is not rotated as well. Shape parameters that are not stated are typical.
    """
    has_magnitude = any(name in stated for name in kind.magnitudes)
    default = {k: p.null if has_magnitude and k in kind.magnitudes else p.start for k, p in kind.params.items()}
    return default | stated


def parse(text: str, robot: Any, present: Iterable[EffectInstance] = ()) -> list[EffectInstance]:
    """Read effects from a text `NAME:WHERE[:param=number,...]`.

    Args:
        text: WHERE is a place of the robot, `all` (one value for all places) or `each` (an effect at each place).
        robot: the RobotModel or Scene with the places.
        present: effects of the model. If one of them is this effect at the place or at `all`, parameters that the text
            does not state keep its values; otherwise see `completed`.

    Raises:
        UserError: no such effect, place or parameter, or a number out of bounds.
    """
    name, _, rest = text.partition(":")
    where, _, settings = rest.partition(":")
    kind = effect(name)
    if not where:
        choices = [*kind.targets(robot), *MANY]
        raise UserError(f"{name} needs a place", expected=f"{name}:WHERE", choices=choices)
    stated = values(kind, [s for s in settings.split(",") if s])
    values_of_all = completed(kind, stated)
    places = instances(kind, where, robot) if where == EACH else [place(kind, where, robot)]
    here: dict[str, EffectInstance] = {}  # by place
    for e in present:  # of two at one place the later one counts
        if e.effect == name:
            here |= {w: replace(e, where=w) for w in (places if e.where == ALL else [e.where])}
    changed = {w: e.with_values(**stated) if stated else e for w, e in here.items()}
    return [changed.get(w) or EffectInstance.of(name, w, **values_of_all) for w in places]
