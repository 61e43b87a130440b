"""Measures what policies lose in other worlds, factor by factor.

All policies play the same seeds. The first world is the training world, the others are targets. The loss in a combined
world (VNP combines V, N and P) is split into shares. Controls are played in the first and the last world; the blind
control is a policy of its own, of modality `proprio`. Writes OUT/gap.json, OUT/gap.html, OUT/episodes.jsonl.

A policy that was trained in a target is refused without --fine-tuned. --measured replaces a target by a real robot's
trials (CSV: policy, configuration, seed, outcome, category). --records reuses episodes of `vispeg evaluate` or of an
earlier gap; films need the policies too.

Example:
    vispeg gap runs/depth_s* runs/rgb_s* --worlds S V N P VNP --episodes 500 --workers 2 --out gap
    vispeg gap --records gap/episodes.jsonl --worlds S VNP --out again
    vispeg gap runs/depth_s* runs/rgb_s* --records gap/episodes.jsonl --episodes 500 --videos 4 --out filmed
    vispeg gap depth=runs/d/best --worlds S --measured robot.csv --out real
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.evaluation.trials import Played, Trials
from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg gap`."""

    out: Path
    """Folder for the results."""
    policies: tyro.conf.Positional[tuple[str, ...]] = ()
    """Policy folders, NAME=FOLDER, MODULE:CLASS or .zip files; replicas of one name differ in their training seed."""
    worlds: tuple[str, ...] = ("S", "V", "N", "P", "VNP")
    """Built-in worlds' names or world files; the first is the training world."""
    episodes: int = 100
    """Episodes of every policy in every world."""
    controls: tuple[str, ...] | None = None
    """shuffled, frozen, and GOAL_fixed with the cell's name of the goal; default: all."""
    control_worlds: tuple[str, ...] | None = None
    """Worlds of the controls; default: the first and the last of --worlds."""
    records: tuple[Path, ...] = ()
    """Files of episodes to reuse."""
    measured: Path | None = None
    """CSV of a real robot's trials."""
    robot: str = "robot"
    """The name of the measured target in tables."""
    videos: int = 2
    """Episodes of each policy to film in the first and the last world, new failures first."""
    fine_tuned: bool = False
    """Allow policies that were trained or fine-tuned in a target."""
    trials: Played = Trials()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints the gaps."""
        from vispeg.api.gap import gap

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
            **self.trials.options(self.out),
        )
        self.trials.give(result, self.out / "gap.html")
        return 0
