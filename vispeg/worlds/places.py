"""Places of effects: the meaning of `all`, `each` and a target's name, and arrays of parameters by target."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.effect import Effect, EffectInstance
from vispeg.core.errors import UserError

ALL = "all"  # one value, shared by every target
EACH = "each"  # a value of its own for every target
MANY = (ALL, EACH)


def check(
    kind: Effect,
    where: Any,
    model: Any,
    *,
    many: Sequence[str] = (ALL,),
    file: str | Path | None = None,
    key: str | None = None,
) -> str:
    """Check that an effect can act at a place, and return the place.

    Args:
        kind: the effect.
        where: a target's name, or one of `many`.
        model: the RobotModel or Scene with the targets.
        many: the allowed words for several targets.
        file, key: file and key that state the place, for the error.

    Raises:
        UserError: no such place (it lists the choices), or the effect has no place at all in this model.
    """
    targets = kind.targets(model)
    if not targets:
        expected = "a cell with what it acts on: a camera, a light, a part, a fixture"
        raise UserError(f"{kind.name} has no place here", file=file, key=key, expected=expected, got=where)
    if not isinstance(where, str) or where not in (*targets, *many):
        raise UserError(f"{kind.name} has no such place", file=file, key=key, got=where, choices=[*targets, *many])
    return where


def instances(kind: Effect, where: str, model: Any) -> list[str]:
    """List the places of the effect's instances: every target for `each`, else only `where`."""
    return kind.targets(model) if where == EACH else [where]


def acts_on(where: str, names: Iterable[str]) -> bool:
    """Return whether an effect at `where` acts on any of these targets."""
    return where in MANY or where in names


def values(kind: Effect, rows: Sequence[Iterable[EffectInstance]], model: Any) -> dict[str, np.ndarray]:
    """Return the parameters of one effect as arrays: name -> (len(rows), ntarget).

    Entries without the effect have the values of an absent effect.

    Args:
        kind: the effect.
        rows: the effects of each row; other kinds are ignored, and of two at one place the later one counts.
        model: the RobotModel or Scene whose targets are the columns.

    Raises:
        UserError: an effect at a place that the model does not have.
    """
    targets = kind.targets(model)
    out = kind.absent((len(rows), len(targets)))
    for row, placed in enumerate(rows):
        for at in placed:
            if at.effect != kind.name:
                continue
            if at.where != ALL and at.where not in targets:
                check(kind, at.where, model, key="where")
            columns = slice(None) if at.where == ALL else targets.index(at.where)
            for name, value in at.params.items():
                out[name][row, columns] = value.value
    return out
