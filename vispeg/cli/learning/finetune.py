"""Fine-tunes a policy in a target world on demonstrations.

Writes a policy's folder; finetune.json in it states success in the target before and after.

Example:
    vispeg finetune runs/depth/best --world dev --teacher expert --demos 100 --out tuned
    vispeg finetune runs/depth/best --world dev --dataset demos --out tuned
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg finetune`."""

    policy: tyro.conf.Positional[Path]
    """A policy's folder, or a bundled policy's name."""
    world: str
    """The target world: a built-in name or a world file."""
    out: Path
    """Folder of the new policy."""
    teacher: str = "expert"
    """Demonstrator: expert for the scripted policy, or a state policy's folder or name."""
    dataset: Path | None = None
    """Demonstrations in LeRobot's layout, in place of a teacher. FOLDER?action=KIND says what its actions are."""
    starts: Path | None = None
    """A folder of trials: demonstrations begin as those that failed began."""
    demos: int = 100
    """Successful demonstrations in the target world."""
    updates: int = 2000
    """Gradient steps. Image encoders are frozen for the first half, then learn at a hundredth of --lr."""
    lr: float | None = None
    """Learning rate; default: a tenth of that of training."""
    known: float = 0.15
    """Share of each batch from the training world, 0 to 0.5."""
    known_world: str | None = None
    """The training world, if the policy's record names no built-in one."""
    episodes: int = 50
    """Episodes of the evaluations before and after."""
    seed: int = 0
    """Seed of everything random."""
    device: Literal["cpu", "cuda", "auto"] = "cpu"
    """Where the network runs."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Fine-tunes and says what it brought."""
        from vispeg.api.learning.finetune import finetune

        result = finetune(
            self.policy,
            self.world,
            self.out,
            teacher=self.teacher,
            dataset=self.dataset,
            starts=self.starts,
            demos=self.demos,
            updates=self.updates,
            lr=self.lr,
            known=self.known,
            known_world=self.known_world,
            episodes=self.episodes,
            seed=self.seed,
            device=self.device,
            overwrite=self.overwrite,
            say=(lambda text: None) if self.output.quiet else self.output.line,
        )
        self.output.give(result.record, result.summary if self.output.quiet else result.summary[-1:])
        return 0
