"""Effects as a person writes them on a command line: `coulomb_friction:joint4:torque=1.2`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from vispeg.core.effect import Effect, EffectInstance, effect
from vispeg.core.errors import UserError


def place(kind: Effect, where: str, robot: Any) -> str:
    """`where` if the effect can act there on this robot (a RobotModel); `all` and `all-joints` mean every place.

    Raises:
        UserError: no such place; it lists those there are.
    """
    targets = kind.targets(robot)
    if not targets:
        raise UserError(f"{kind.name} acts on a scene, not on an arm alone", expected="a world file of the peg task")
    if where in ("all", "all-joints"):
        return "all" if len(targets) > 1 else targets[0]
    if where not in targets:
        raise UserError(f"{kind.name} has no such place", got=where, choices=[*targets, "all"])
    return where


def values(kind: Effect, pairs: Iterable[str]) -> dict[str, float]:
    """Parameter values from `name=number` texts, checked against names and bounds."""
    out: dict[str, float] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals:
            raise UserError("not a parameter setting", expected="name=number", got=pair, choices=kind.params)
        if name not in kind.params:
            raise UserError(f"{kind.name} has no such parameter", got=name, choices=kind.params)
        param = kind.params[name]
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not param.low <= number <= param.high:  # NaN is refused too
            expected = f"a number from {param.low:g} to {param.high:g} {param.unit}"
            raise UserError(f"{kind.name}: {name} is out of bounds", expected=expected, got=text)
        out[name] = number
    return out


def parse(text: str, robot: Any) -> list[EffectInstance]:
    """Effects from `NAME:WHERE[:param=number,...]`; what is not given takes its typical size.

    WHERE is a place of the robot, `all` (one value shared by all places) or `each` (one effect for each place).
    """
    name, _, rest = text.partition(":")
    where, _, settings = rest.partition(":")
    kind = effect(name)
    if not where:
        choices = [*kind.targets(robot), "all", "each"]
        raise UserError(f"{name} needs a place", expected=f"{name}:WHERE", choices=choices)
    given = values(kind, [s for s in settings.split(",") if s])
    typical = {k: p.start for k, p in kind.params.items()} | given
    places: Sequence[str] = kind.targets(robot) if where == "each" else [place(kind, where, robot)]
    return [EffectInstance.of(name, w, **typical) for w in places]
