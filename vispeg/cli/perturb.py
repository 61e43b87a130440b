"""Pushes and hard positions: success where the hole is hardest to find, still and pushed by 20-60 N for 0.2 s.

Writes OUT/perturb.json and OUT/perturb.html: an interval a position, and what the push costs there.

Example:
    vispeg perturb runs/peg-state/best --world randomized --episodes 40 --out pushed
    vispeg perturb runs/peg-depth/best --positions my-positions.yaml --force 20 40 --out pushed
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from vispeg.cli.output import Output, Told
from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg perturb`."""

    policies: tyro.conf.Positional[tuple[str, ...]]
    """Policy folders, or NAME=FOLDER."""
    out: Path
    """Folder for the results."""
    world: str = "randomized"
    """A built-in world's name or a world file."""
    episodes: int = 40
    """Trials a position, still and pushed each."""
    force: tuple[float, float] = (20.0, 60.0)
    """N, range of the pushes."""
    duration: float = 0.2
    """s, of a push."""
    positions: Path | None = None
    """A list of your own, `format: vispeg-positions/1`."""
    clearance: float | None = None
    """Diametral clearance in mm in place of the world's."""
    seed: int = 0
    """Another number takes other episodes."""
    workers: int = 1
    """Processes."""
    overwrite: bool = False
    """Replace OUT's result."""
    output: Told = Output()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints the table."""
        from vispeg.api.playing import check_numbers
        from vispeg.cli.evaluation import (
            at_clearance,
            open_folder,
            play_all,
            table,
            write_result,
        )
        from vispeg.core.errors import UserError
        from vispeg.core.files import write_text_atomic
        from vispeg.evaluation import perturb
        from vispeg.evaluation.jobs import Pushes, make_jobs, seeds_of
        from vispeg.evaluation.players import ready
        from vispeg.report.gap import words
        from vispeg.report.gap.perturb_page import render
        from vispeg.task.registry import config_of, task_of
        from vispeg.task.world_file import load_world

        check_numbers(self.episodes, self.workers)
        if not 0 <= self.force[0] <= self.force[1] or not self.duration > 0:
            raise UserError("not a push", key="--force", expected="low <= high, a duration above 0", got=self.force)
        who, world = ready(self.policies), load_world(self.world)
        task = at_clearance(who, world, self.clearance)
        listed = perturb.positions(self.positions, task_of(config_of(world.task)))
        read = [world.path, self.positions, *(e.path for e in who)]
        out = open_folder(self.out, "perturb.json", self.overwrite, read)
        settings = perturb.settings(self.world, world.name, listed, Pushes(self.force, self.duration))
        settings = [replace(s, task={**s.task, **task}) for s in settings]
        jobs = make_jobs(who, settings, seeds_of(self.episodes, self.seed), out / "worlds")
        values = perturb.summarise(play_all(jobs, out, self.workers, self.output.quiet))
        values |= {"world": {"name": world.name, "hash": world.hash}, "force": self.force, "duration": self.duration}
        values = write_result(out, "perturb.json", values, self.seed, [e.path for e in who if e.path.exists()])
        page = write_text_atomic(out / "perturb.html", render(values), overwrite=True)
        heads = ("policy", "position", "still", "pushed", "lost by the push")
        rows = [[r["policy"], r["position"], *(_cell(r[k], words) for k in _SIDES)] for r in values["rows"]]
        self.output.give(values, [table(heads, rows), str(page)])
        return 0


_SIDES = ("still", "pushed", "cost")


def _cell(e, words) -> str:  # type: ignore[no-untyped-def]
    if e is None:
        return "-"
    return words.lost(e) if e["low"] < 0 else words.rate(e)
