"""Say what each added effect explains, by the held-out error of the final model without it, the others unchanged.

Nothing is refitted. So the shares of several effects need not sum to 1: a share exceeds 1 if the others make up for
the effect and its absence leaves more error than the user's model had, and two effects that can replace each other in
part explain less each than both together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NotRequired, TypedDict

import numpy as np

from vispeg.core.rules import RULES
from vispeg.diagnosis.selection.judge import Judge
from vispeg.worlds.world import World


class Share(TypedDict):
    """What an effect explains, as in `FoundEffect`; each key is absent if it is not known."""

    without: NotRequired[float]
    explains: NotRequired[float]


def each_left_out(world: World, n_fixed: int) -> list[World]:
    """Return for each effect after the first `n_fixed` the world without it."""
    return [world.without(e.effect, e.where) for e in world.effects[n_fixed:]]


def shares(judge: Judge, world: World, n_fixed: int, before: float, after: float, floor: float) -> dict[str, Share]:
    """Return the share of each effect after the first `n_fixed` of the final model, by its label.

    Args:
        judge: of the held-out evidence.
        world: the final model.
        n_fixed: number of effects that were given.
        before, after, floor: as `share` takes them.
    """
    worlds, evidence = each_left_out(world, n_fixed), judge.evidence
    if not worlds:
        return {}
    squares = [judge.mean(loss) for loss in judge.losses(worlds)]
    times = [error / evidence.floor for error in evidence.errors(worlds)]
    return by_label(world, n_fixed, times, squares, before, after, floor)


def by_label(
    world: World,
    n_fixed: int,
    times: Sequence[float],
    squares: Sequence[float],
    before: float,
    after: float,
    floor: float = 1.0,
) -> dict[str, Share]:
    """Return the `share` of each effect after the first `n_fixed`, by its label, from one error of each kind for it."""
    rows = zip(world.effects[n_fixed:], times, squares, strict=True)
    return {e.label: share(t, s, before, after, floor) for e, t, s in rows}


def share(times: float, square: float, before: float, after: float, floor: float = 1.0) -> Share:
    """Return what an effect explains.

    Where the user's model is at the floor (`RULES.at_floor`), there is no excess to share.

    Args:
        times: held-out RMS error without the effect over the noise floor, as in the ladder.
        square: held-out mean squared whitened residual (error over noise) without it.
        before, after: the same of the user's model and of the final one.
        floor: the same of a correct model.
    """
    out: Share = {}
    if np.isfinite(times):
        out["without"] = float(times)
    if before - floor > RULES.at_floor - 1.0 and np.isfinite(square):
        out["explains"] = round(float((square - after) / (before - floor)), 4)
    return out
