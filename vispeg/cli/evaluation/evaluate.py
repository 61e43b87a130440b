"""Evaluates policies in one world, with 95 % intervals.

A policy is a folder with policy.json and policy.safetensors, NAME=FOLDER, `expert` (the scripted one), an .onnx that
says what its numbers mean (`vispeg export`), a policy of your own as MODULE:CLASS or MODULE:FUNCTION, a .zip by
Stable-Baselines3, or what LeRobot saved as lerobot:FOLDER. Where its actions are joints or metres, ?action=KIND behind
it says so (joint_goal, joint_delta, tip_goal, tip_delta). Several play the same seeds. Writes OUT/evaluate.json,
OUT/evaluate.html, OUT/episodes.jsonl and videos of failures: success, time, force, kinds of failure, differences. A
stopped run goes on when the command is repeated.

Example:
    vispeg evaluate runs/{task}-state/20261121-0900_s0/checkpoints/best --world randomized --episodes 500
    vispeg evaluate mine=my_module:Policy model.zip --world VNP
    vispeg evaluate depth=runs/d/best rgb=runs/r/best --world S --controls shuffled frozen --workers 2 --out compared
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from vispeg.cli.evaluation.trials import Played, Trials
from vispeg.cli.tolerance import Room, at_tolerance
from vispeg.core.interrupt import goes_on

if TYPE_CHECKING:
    from vispeg.evaluation.entrants import Entrant
    from vispeg.evaluation.records import Episode


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg evaluate`."""

    policies: tyro.conf.Positional[tuple[str, ...]]
    """Policy folders, NAME=FOLDER, MODULE:CLASS, lerobot:FOLDER, .onnx or .zip files."""
    out: Path | None = None
    """Folder for the results; default: evaluated/POLICIES-WORLD."""
    world: str = "nominal"
    """A built-in world's name or a world file."""
    episodes: int = 100
    """Episodes of every policy."""
    controls: tuple[str, ...] = ()
    """Play also with images shuffled or frozen, or with a goal that never moves (GOAL_fixed)."""
    tolerance: Room = None
    """Width of the goal less that of the part, mm; default: the world's."""
    videos: int = 4
    """Failures of each policy to film; 0 for none."""
    rerun: Path | None = None
    """Write a file FILE.rrd for the Rerun viewer: one episode of each policy in 3D, a failure if any."""
    keep_trials: Path | None = None
    """Keep each episode that is played as a trial in this folder: joints, wrench, pictures, what the policy did."""
    trials: Played = Trials()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints the table."""
        from vispeg.api.evaluate import evaluate
        from vispeg.evaluation.entrants import entrants
        from vispeg.report.rrd.stream import check_target
        from vispeg.task.world_file import load_world

        if self.rerun is not None:
            check_target(self.rerun, self.trials.overwrite)
        who, world = entrants(self.policies), load_world(self.world)
        task = at_tolerance(who, world, self.tolerance)
        out = self.out or Path("evaluated") / f"{'+'.join(dict.fromkeys(e.name for e in who))}-{world.name}"
        result = evaluate(
            self.policies,
            self.world,
            episodes=self.episodes,
            controls=self.controls,
            task=task,
            videos=self.videos,
            trials=self.keep_trials,
            **self.trials.options(out),
        )
        others = []
        if self.rerun is not None:
            self._show(who, task, result.episodes, self.rerun)
            others.append(f"rerun: {self.rerun}")
        self.trials.give(result, out / "evaluate.html", *others)
        return 0

    def _show(self, who: Sequence[Entrant], task: Mapping[str, Any], episodes: Sequence[Episode], file: Path) -> None:
        """Plays one episode of each policy again, the first failure or else the first, and writes the file."""
        from vispeg.report.rrd.episode import played, write_episodes

        replays = []
        for e in who:
            of_policy = [x for x in episodes if (x.policy, x.train_seed, x.control) == (e.name, e.train_seed, "")]
            seed = next((x.seed for x in of_policy if not x.success), of_policy[0].seed)
            replays += played(e, self.world, task, [seed], e.name)
        write_episodes(file, f"evaluate {' '.join(self.policies)}", replays)
