"""`--clearance`: the tolerance that a world's task states (`TaskConfig.tolerance`), as every command calls it."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vispeg.evaluation.entrants import Entrant
    from vispeg.task.world_file import WorldFile

FLAG = "--clearance"


def at_tolerance(who: Iterable[Entrant], world: WorldFile, value: float | None) -> Mapping[str, float]:
    """Give the task of `world` that the option changes; says which policies were made for another tolerance than that.

    Args:
        who: entrants.
        world: what they are judged in.
        value: in place of the world's, in the unit of the task's tolerance; None for the world's own.

    Raises:
        UserError: the task has no tolerance.
    """
    from vispeg.task.registry import config_of, with_tolerance

    task = with_tolerance(world.task, value)
    config = config_of({**world.task, **task})
    if config.tolerance is not None:
        here, unit = getattr(config, config.tolerance.setting), config.tolerance.unit
        for e in who:
            if e.tolerance not in (None, here):
                print(
                    f"{e.name} was made for {e.tolerance:g} {unit}, here it is {here:g} {unit} ({FLAG})",
                    file=sys.stderr,
                )
    return task
