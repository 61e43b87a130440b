"""Evaluates policies in one world: success with its interval, time, force, how they fail, against each other, controls.

A policy is a folder with policy.json and policy.safetensors, NAME=FOLDER, or `expert`, the scripted one; several are
compared on the same seeds.
Writes OUT/evaluate.json, OUT/evaluate.html, OUT/episodes.jsonl and videos of failures. A run that was stopped
goes on when the command is given again.

Example:
    vispeg evaluate runs/peg-state/20261121-0900_s0/checkpoints/best --world randomized --episodes 500
    vispeg evaluate depth=runs/d/best rgb=runs/r/best --world S --controls shuffled frozen --workers 2 --out compared
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg evaluate`."""

    policies: tyro.conf.Positional[tuple[str, ...]]
    """Policy folders, or NAME=FOLDER."""
    out: Path | None = None
    """Folder for the results; evaluated/POLICIES-WORLD where not given."""
    world: str = "nominal"
    """A built-in world's name or a world file."""
    episodes: int = 100
    """Episodes of every policy."""
    controls: tuple[str, ...] = ()
    """shuffled, frozen, hole_fixed: the same policies with their sight taken away in that way."""
    clearance: float | None = None
    """Diametral clearance in mm in place of the world's."""
    videos: int = 4
    """Failures of each policy that are filmed; 0 for none."""
    seed: int = 0
    """Another number takes other episodes."""
    workers: int = 1
    """Processes."""
    overwrite: bool = False
    """Replace OUT's result."""
    quiet: bool = False
    """No progress bar."""

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints the table."""
        import json

        from vispeg.cli.evaluation import (
            at_clearance,
            check_episodes,
            open_folder,
            play_all,
            print_table,
            write_result,
        )
        from vispeg.core.errors import UserError
        from vispeg.core.files import write_text_atomic
        from vispeg.evaluation.controls import CONTROLS
        from vispeg.evaluation.gap import gap
        from vispeg.evaluation.jobs import Setting, make_jobs, seeds_of
        from vispeg.evaluation.media import film_failures
        from vispeg.evaluation.players import ready
        from vispeg.report.gap import words
        from vispeg.report.gap.build import write
        from vispeg.task.world_file import load_world

        check_episodes(self.episodes, self.workers)
        for control in self.controls:
            if control not in CONTROLS:
                raise UserError("unknown control", key="--controls", got=control, choices=CONTROLS)
        who, world = ready(self.policies), load_world(self.world)
        task = at_clearance(who, world, self.clearance)
        out = self.out or Path("evaluated") / f"{'+'.join(dict.fromkeys(e.name for e in who))}-{world.name}"
        out = open_folder(out, "evaluate.json", self.overwrite, [world.path, *(e.path for e in who)])
        settings = [Setting(self.world, world.name, task=task, control=c) for c in ("", *self.controls)]
        jobs = make_jobs(who, settings, seeds_of(self.episodes, self.seed), out / "worlds", profile=True)
        episodes = play_all(jobs, out, self.workers, self.quiet)
        scripted = [e.name for e in who if e.scripted]
        values = gap(episodes, world.name, seed=self.seed, scripted=scripted)
        values["notes"] += [words.told(r) for r in values["success"] if r["needed"]]
        media = film_failures(jobs, episodes, out / "media", self.videos) if self.videos else []
        write_text_atomic(out / "media.json", json.dumps(media) + "\n", overwrite=True)
        values = write_result(out, "evaluate.json", values, self.seed, [e.path for e in who if e.path.exists()])
        page = write(out, "evaluate", overwrite=True)
        heads = ("policy", "success", "time", "peak force", "failures")
        print_table(heads, [_row(r, words) for r in values["success"]])
        for r in values["success"]:
            if r["needed"]:
                print(words.told(r))
        for c in values["comparisons"]:
            print(f"{c['first']} - {c['second']}: {words.lost(c['difference'])} points, {c['verdict']}")
        print(page)
        return 0


def _row(r, words) -> list[str]:  # type: ignore[no-untyped-def]
    failures = ", ".join(f"{k} {v}" for k, v in sorted(r["categories"].items()) if k != "success")
    time = "-" if r["time"] is None else f"{r['time']:.1f} s"
    force = "-" if r["peak_force"] is None else f"{r['peak_force']:.0f} N"
    return [words.name(r), words.rate(r["success"]), time, force, failures]
