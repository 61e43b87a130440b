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

from vispeg.cli.output import Output, Told
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
    output: Told = Output()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints the table."""
        from vispeg.api.evaluate import evaluate
        from vispeg.cli.evaluation import at_clearance
        from vispeg.cli.progress import playing
        from vispeg.evaluation.entrants import entrants
        from vispeg.report.summary import Line
        from vispeg.task.world_file import load_world

        who, world = entrants(self.policies), load_world(self.world)
        task = at_clearance(who, world, self.clearance)
        out = self.out or Path("evaluated") / f"{'+'.join(dict.fromkeys(e.name for e in who))}-{world.name}"
        result = evaluate(
            self.policies,
            self.world,
            episodes=self.episodes,
            controls=self.controls,
            task=task,
            videos=self.videos,
            seed=self.seed,
            workers=self.workers,
            out=out,
            overwrite=self.overwrite,
            playing=lambda jobs, folder: playing(jobs, folder, self.output.quiet),
        )
        self.output.give(result.record, [*result.summary, Line(str(out / "evaluate.html"), path=True)])
        return 0
