"""The option `--clearance`, which sets the tolerance of a world's task (`TaskConfig.tolerance`)."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vispeg.evaluation.entrants import Entrant
    from vispeg.task.world_file import WorldFile

FLAG = "--clearance"


def at_tolerance(who: Iterable[Entrant], world: WorldFile, value: float | None) -> Mapping[str, float]:
    """Return the settings of the world's task that the option changes, and print which policies were made for others.

    Args:
        who: the policies.
        world: the world in which they are judged.
        value: the tolerance, in the task's unit; None for the world's.

    Raises:
        UserError: the task has no tolerance.
    """
    from vispeg.task.registry import config_of, with_tolerance

    task = with_tolerance(world.task, value)
    config = config_of({**world.task, **task})
    if config.tolerance is not None:
        of_world, unit = getattr(config, config.tolerance.setting), config.tolerance.unit
        for e in who:
            if e.tolerance not in (None, of_world):
                print(
                    f"{e.name} was made for {e.tolerance:g} {unit}, here it is {of_world:g} {unit} ({FLAG})",
                    file=sys.stderr,
                )
    return task
