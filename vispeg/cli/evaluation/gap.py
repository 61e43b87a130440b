"""Measures what policies lose in other worlds, factor by factor.

All policies play the same seeds. Losses count from the first world, the others are targets. The loss in a combined
world (VNP combines V, N and P) is split into shares. Controls are played in the first and the last world; the blind
control is a policy of its own, of modality `proprio`. Writes OUT/gap.json, OUT/gap.html, OUT/episodes.jsonl.

A world that a policy was trained in is its home, and marked so. A policy that was trained with a part of a target is
refused without --fine-tuned. --measured adds a real robot's trials as a target: a folder of `vispeg run`, or a CSV
(policy, configuration, seed, outcome, category). --records reuses episodes of `vispeg evaluate` or of an earlier gap;
films need the policies too.

Example:
    vispeg gap runs/depth_s* runs/rgb_s* --worlds S V N P VNP --episodes 500 --workers 2 --out gap
    vispeg gap --records gap/episodes.jsonl --worlds S VNP --out again
    vispeg gap runs/depth_s* runs/rgb_s* --records gap/episodes.jsonl --episodes 500 --videos 4 --out filmed
    vispeg gap depth=runs/d/best --worlds S --measured robot.csv --out real
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from vispeg.cli.evaluation.trials import Played, Trials
from vispeg.core.interrupt import goes_on

if TYPE_CHECKING:
    from vispeg.evaluation.jobs import Job
    from vispeg.evaluation.runner import Watch


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg gap`."""

    out: Path
    """Folder for the results."""
    policies: tyro.conf.Positional[tuple[str, ...]] = ()
    """Policy folders, NAME=FOLDER, MODULE:CLASS, lerobot:FOLDER, .onnx or .zip files. Replicas of a name differ in
    training seed."""
    worlds: tuple[str, ...] = ("S", "V", "N", "P", "VNP")
    """Built-in worlds' names or world files; losses count from the first."""
    episodes: int = 100
    """Episodes of every policy in every world, and as many for each control in each of --control-worlds."""
    controls: tuple[str, ...] | None = None
    """shuffled, frozen, and GOAL_fixed with the cell's name of the goal; none: without; default: all."""
    control_worlds: tuple[str, ...] | None = None
    """Worlds of the controls; default: the first and the last of --worlds."""
    records: tuple[Path, ...] = ()
    """Files of episodes to reuse."""
    measured: Path | None = None
    """A real robot's trials: a CSV, or a folder of trials as `vispeg run` keeps them."""
    robot: str = "robot"
    """The name of the measured target in tables."""
    videos: int = 2
    """Episodes of each policy to film in the first and the last world, new failures first."""
    fine_tuned: bool = False
    """Allow policies that were trained or fine-tuned with a part of a target."""
    trials: Played = Trials()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints the gaps."""
        from vispeg.api.gap import gap

        options = self.trials.options(self.out)
        bar = options["playing"]

        def told(jobs: Sequence[Job], folder: Path) -> AbstractContextManager[Watch]:
            if not self.trials.output.quiet and (text := _said(jobs)):
                print(text, file=sys.stderr)
            return bar(jobs, folder)

        options["playing"] = told
        result = gap(
            self.policies,
            self.worlds,
            episodes=self.episodes,
            controls=self.controls,
            control_worlds=self.control_worlds,
            records=self.records,
            measured=self.measured,
            robot=self.robot,
            videos=self.videos,
            fine_tuned=self.fine_tuned,
            **options,
        )
        self.trials.give(result, self.out / "gap.html")
        return 0


def _said(jobs: Sequence[Job]) -> str:
    """How many episodes are asked for, where controls make them more than --episodes says; else nothing."""
    total, controlled = sum(len(j.seeds) for j in jobs), sum(len(j.seeds) for j in jobs if j.control)
    return (
        f"{total} episodes, {controlled} of them of controls (--controls none leaves those out)" if controlled else ""
    )
