"""Fine-tunes a trained policy in a target world on a few demonstrations.

Writes a policy's folder with finetune.json (success in the target before and after) in it.

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
    """A policy's folder, or the name of one that comes with the package."""
    world: str
    """The target world: a built-in name or a world file."""
    out: Path
    """Folder of the new policy."""
    teacher: str = "expert"
    """Who demonstrates: expert for the scripted policy, or a state policy's folder or name."""
    dataset: Path | None = None
    """Demonstrations in LeRobot's layout, in place of the teacher's."""
    demos: int = 100
    """Successful demonstrations in the target world."""
    updates: int = 2000
    """Gradient steps; image encoders are frozen for the first half, and learn at a hundredth of --lr after it."""
    lr: float | None = None
    """Learning rate; where not given, a tenth of the one that the policy was trained at."""
    known: float = 0.15
    """Share of each batch from the world that the policy was trained in, 0 to 0.5."""
    known_world: str | None = None
    """That world, if the policy's own record does not name a built-in one."""
    episodes: int = 50
    """Episodes of the evaluations before and after."""
    seed: int = 0
    """Seed of everything random."""
    device: Literal["cpu", "cuda", "auto"] = "cpu"
    """Where the network runs."""
    overwrite: bool = False
    """Replace OUT if it is there."""
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
