"""What the commands on success share: playing with a progress bar, and a clearance in place of the world's."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from vispeg.evaluation.entrants import Entrant
from vispeg.evaluation.jobs import Job
from vispeg.evaluation.records import Episode
from vispeg.task.world_file import WorldFile


def play_all(jobs: Sequence[Job], out: Path, workers: int, quiet: bool) -> list[Episode]:
    """All episodes of the jobs, with a bar for each policy, and the success so far."""
    from vispeg.cli.progress import playing
    from vispeg.evaluation import runner

    with playing(jobs, out, quiet) as watch:
        return runner.run(jobs, out, workers, watch=watch)


def at_clearance(who: Iterable[Entrant], world: WorldFile, clearance: float | None) -> Mapping[str, float]:
    """The task of `world` that `--clearance` changes; says which policies were made for another clearance than that.

    Args:
        who: entrants.
        world: what they are judged in.
        clearance: diametral, mm, in place of the world's; None for the world's own.
    """
    from vispeg.task.registry import config_of

    task = {} if clearance is None else {"clearance_mm": clearance}
    here = getattr(config_of({**world.task, **task}), "clearance_mm", None)
    for e in who:
        if e.clearance_mm not in (None, here):
            print(f"{e.name} was made for {e.clearance_mm:g} mm, here it is {here:g} mm (--clearance)", file=sys.stderr)
    return task
