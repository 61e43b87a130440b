"""Trains a policy for the task of a world.

TASK is the task and what the policy sees: peg-state, peg-proprio, peg-depth, peg-rgb or peg-rgbd, or LABEL-MODALITY of
a task of your own. The run's folder holds config.yaml, progress.csv,
tensorboard/ and checkpoints/best and checkpoints/last; either checkpoint is a policy that `vispeg play` and `vispeg
evaluate` take.

Example:
    vispeg train peg-state --world nominal --seed 0
    vispeg train peg-state --clearance 0.5 --curriculum 3 1 --target 0.98
    vispeg train peg-state --world randomized --ranges adaptive
    vispeg train peg-state --world P --dof x y z rx ry --stack 4
    vispeg train peg-depth --recipe distill+sac --teacher runs/peg-state/best
    vispeg train peg-depth --recipe distill --dataset demos
    vispeg train --resume runs/peg-state/20261121-0900_s0 --steps 200000
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import tyro

from vispeg.cli.output import Output, Told
from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg train`."""

    task: tyro.conf.Positional[str | None] = None
    """Task and modality, such as peg-depth (peg-state, -proprio, -depth, -rgb, -rgbd); not needed with --resume."""
    recipe: Literal["sac", "distill", "distill+sac"] = "sac"
    """Reinforcement learning, imitation of a teacher that knows the state, or the one after the other."""
    world: str = "nominal"
    """A built-in world's name or a world file."""
    clearance: float | None = None
    """Diametral clearance in mm; the world's where not given."""
    curriculum: tuple[float, ...] = ()
    """Wider clearances (mm) to begin with, widest first; the run moves on when an evaluation reaches 80 %."""
    start_radius: tuple[float, ...] = ()
    """Lateral ranges of starts (m) to begin with, nearest first, each beside a clearance of --curriculum."""
    stack: int | None = None
    """Observations and actions that the policy sees, the present one included; the world's where not given (2)."""
    dof: tuple[str, ...] = ()
    """Directions that the policy moves, of x y z rx ry rz; the world's where not given (x y z)."""
    reward: Literal["shaped", "paper"] | None = None
    """This project's reward, or the one of Kaspar and Bock's paper; the world's where not given (shaped)."""
    ranges: Literal["full", "schedule", "adaptive"] = "full"
    """Randomization from the first step on, opening over the first half of the steps, or, range by range, as the policy
    copes with it."""
    steps: int | None = None
    """Environment steps in all; 100000 where not given. With --resume: up to where to go on."""
    target: float = 0.995
    """Stops early once this success rate was reached in two evaluations in a row, imitation and reinforcement each by
    itself; 2 never stops early."""
    seed: int = 0
    """Seed of networks, exploration and episodes."""
    envs: int = 16
    """Environments that are stepped together."""
    threads: int = 1
    """Threads of the physics and of the networks."""
    utd: float | None = None
    """Critic updates per environment step."""
    recurrent: int = 0
    """Width of an LSTM in place of stacked observations; 0 for none."""
    symmetric: bool = False
    """Critics that see what the actor sees, in place of ground truth; slower, and there for comparison."""
    teacher: str | None = None
    """Folder or name of the policy that teaches in the distill recipes, or expert for the scripted one."""
    dataset: Path | None = None
    """Demonstrations in LeRobot's layout, as `vispeg render` writes them: what the distill recipes imitate in place of
    a teacher, or half of each batch of sac. Only episodes that succeeded count."""
    distill_steps: int = 4000
    """Environment steps of each of the five rounds of a distillation."""
    distill_updates: int = 2000
    """Gradient steps after each round of a distillation."""
    distill_looks: int = 1
    """Looks of the world in which a distillation keeps each state; each one more is drawn beside the episode's own."""
    every: int = 5000
    """Environment steps between evaluations and checkpoints."""
    episodes: int = 50
    """Episodes of an evaluation."""
    films: int = 2
    """Episodes of the best policy that are filmed at the end, where the run has no films yet."""
    device: Literal["cpu", "cuda", "auto"] = "cpu"
    """Where networks run."""
    wandb: str | None = None
    """A project of Weights & Biases that the curves are sent to as well (WANDB_MODE=offline keeps them in the run)."""
    out: Path | None = None
    """Folder of the run; runs/TASK/TIME_sSEED where not given."""
    resume: Path | None = None
    """Goes on with the run in this folder, from its last checkpoint, as if it had never stopped. Of the other options
    only --steps and --films may stand beside it."""
    output: Told = Output()

    def run(self) -> int:
        """Trains and says where the policy is."""
        from vispeg.core.errors import UserError
        from vispeg.core.extras import require

        if self.films < 0:
            raise UserError("must not be negative", key="--films", got=self.films)
        if self.wandb is not None:
            require("wandb", "--wandb")
        return self._train() if self.resume is None else self._resume(self.resume)

    def _train(self) -> int:
        from vispeg.core.errors import UserError
        from vispeg.learn.config import TrainConfig
        from vispeg.learn.methods.curriculum import stages
        from vispeg.learn.modalities import modality, names
        from vispeg.learn.settings import defaults
        from vispeg.learn.train import train
        from vispeg.task.environments.vector import world_of
        from vispeg.task.registry import task_of

        settings = self._settings()
        task = world_of(self.world, dict(settings))[1]
        asked = self.task or ""
        label, _, name = asked.partition("-")
        if not name or label != task_of(task).label:
            known = [f"{task_of(task).label}-{name}" for name in names()]
            raise UserError("no such task", got=asked, expected=f"one of the world {self.world}", choices=known)
        seen = modality(name)
        sac = defaults(bool(seen.kinds))
        utd = sac.utd if self.utd is None else self.utd
        sac = replace(sac, recurrent=self.recurrent, utd=utd, symmetric=self.symmetric)
        rounds = {"steps": self.distill_steps, "updates": self.distill_updates, "looks": self.distill_looks}
        config = TrainConfig(
            asked,
            self.recipe,
            self.world,
            100_000 if self.steps is None else self.steps,
            self.seed,
            self.envs,
            self.every,
            self.episodes,
            self.target,
            stages=stages(self.curriculum, self.start_radius, task),
            settings=settings,
            sac=sac,
            teacher=self.teacher,
            dataset=None if self.dataset is None else str(self.dataset),
            distill={} if self.recipe == "sac" else rounds,
            device=self.device,
            threads=self.threads,
            ranges=self.ranges,
            wandb=self.wandb or "",
        )
        out = self.out or Path("runs") / asked / f"{time.strftime('%Y%m%d-%H%M%S')}_s{self.seed}"
        with self._goes_on(out):
            self._tell(train(config, out, show=not self.output.quiet), out, self.world, settings)
        return 0

    def _settings(self) -> Mapping[str, Any]:
        """Of the task, in place of the world's."""
        from vispeg.core.errors import UserError

        if self.recurrent and self.stack not in (None, 1):
            expected = "one of them, as the LSTM stands in place of the stack"
            raise UserError("a memory and a stack", key="--stack", expected=expected, got=self.stack)
        asked = {"clearance_mm": self.clearance, "stack": self.stack, "dof": self.dof or None, "reward": self.reward}
        return {key: value for key, value in asked.items() if value is not None}

    def _resume(self, folder: Path) -> int:
        from vispeg.core.errors import UserError
        from vispeg.learn.config import read_config
        from vispeg.learn.train import resume

        others = [f for f in fields(self) if f.name not in ("resume", "steps", "films", "output")]
        given = [f.name for f in others if getattr(self, f.name) != f.default]
        if given:
            got = " ".join("TASK" if name == "task" else f"--{name.replace('_', '-')}" for name in given)
            expected = "--steps and --films alone"
            raise UserError("goes on as the run was begun", key="--resume", expected=expected, got=got)
        with self._goes_on(folder):
            best = resume(folder, self.steps, show=not self.output.quiet)
            config = read_config(folder / "config.yaml")
            self._tell(best, folder, config.world, config.settings)
        return 0

    def _goes_on(self, folder: Path) -> AbstractContextManager[None]:
        films = () if self.films == type(self).films else ("--films", str(self.films))
        return goes_on(instead=("train", "--resume", str(folder), *films))

    def _tell(self, best: Path, folder: Path, world: str, settings: Mapping[str, Any]) -> None:
        """Says where the policy is, and films it unless that was done before."""
        self.output.line(f"best policy: {best}")
        made = list[dict[str, object]]()
        if self.films and not (folder / "films").exists():
            from vispeg.cli.learning.play import films
            from vispeg.learn.envs import HELD_OUT

            seeds = [HELD_OUT + k for k in range(self.films)]
            for film in films(best, world, dict(settings), seeds, folder / "films", False):
                made.append(asdict(film))
                self.output.line(film.line)
        self.output.give({"run": str(folder), "best": str(best), "films": made}, [])
