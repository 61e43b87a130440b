"""Trains a policy for the task of a world.

TASK is the task and what the policy sees: {task}-state, {task}-proprio, {task}-depth, {task}-rgb, {task}-rgbd, or
{task}-privileged (a teacher with ground truth); or LABEL-MODALITY of your own task. The run's folder holds config.yaml,
progress.csv, tensorboard/, checkpoints/best and, after reinforcement learning, checkpoints/last. Each checkpoint is a
policy for `vispeg play` and `vispeg evaluate`.

Example:
    vispeg train {task}-state --world nominal --seed 0
    vispeg train {task}-state {tolerance} 0.5 --curriculum 3 1 --target 0.98
    vispeg train {task}-state --world randomized --ranges adaptive
    vispeg train {task}-state --world P --dof x y z rx ry --stack 4
    vispeg train {task}-depth --recipe distill+sac --teacher runs/{task}-state/best
    vispeg train {task}-depth --recipe distill --dataset demos
    vispeg train --resume runs/{task}-state/20261121-0900_s0 --steps 200000
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from vispeg.cli.options import options
from vispeg.cli.output import Output, OutputOptions
from vispeg.cli.tolerance import Room
from vispeg.core.interrupt import goes_on

if TYPE_CHECKING:
    from vispeg.api.train import TrainedPolicy


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg train`."""

    task: tyro.conf.Positional[str | None] = None
    """The task and what the policy sees, such as LABEL-depth; not needed with --resume."""
    recipe: Literal["sac", "distill", "distill+sac"] = "sac"
    """Reinforcement learning, imitation of a teacher, or imitation and then reinforcement."""
    world: str = "nominal"
    """A built-in world's name or a world file."""
    tolerance: Room = None
    """Width of the goal less that of the part, mm; default: the world's."""
    curriculum: tuple[float, ...] = ()
    """Wider tolerances to begin with, mm, widest first; the next stage begins at 80 % success."""
    start_radius: tuple[float, ...] = ()
    """Lateral ranges of starts for these stages, m, nearest first."""
    stack: int | None = None
    """Observations and actions that the policy sees, with the present one; default: the world's (2)."""
    dof: tuple[str, ...] = ()
    """Directions that the policy moves, of x y z rx ry rz; default: the world's (x y z)."""
    reward: Literal["shaped", "paper"] | None = None
    """This project's reward, or that of Kaspar and Bock; default: the world's (shaped)."""
    ranges: Literal["full", "schedule", "adaptive"] = "full"
    """Randomization: full from the first step, growing over the first half of the steps, or range by range with
    success."""
    steps: int | None = None
    """Environment steps in all; default: 100000. With --resume: the new total."""
    target: float = 0.995
    """Success rate in two evaluations in a row that ends imitation or reinforcement early; 2 for never."""
    seed: int = 0
    """Seed of networks, exploration and episodes."""
    envs: int = 16
    """Environments in one batch."""
    threads: int = 1
    """Threads of the physics and of the networks."""
    utd: float | None = None
    """Critic updates per environment step."""
    recurrent: int = 0
    """Width of an LSTM in place of stacked observations; 0 for none."""
    symmetric: bool = False
    """Critics see what the actor sees, in place of ground truth (slower; for comparison)."""
    replay: int | None = None
    """Transitions kept in memory and in each checkpoint; default: 300000, with images 100000. The size is said at the
    start."""
    teacher: str | None = None
    """Teacher of the distill recipes: a policy's folder or name, or expert for the scripted one."""
    dataset: Path | None = None
    """Demonstrations in LeRobot's layout, as of `vispeg render`: in place of a teacher (distill), or half of each batch
    (sac). Only successful episodes count."""
    distill_steps: int = 4000
    """Environment steps of each of the five rounds of distill."""
    distill_updates: int = 2000
    """Gradient steps after each round of distill."""
    distill_looks: int = 1
    """Looks in which distill stores each state: the episode's own and others."""
    every: int = 5000
    """Environment steps between evaluations and checkpoints."""
    episodes: int = 50
    """Episodes of an evaluation."""
    films: int = 2
    """Episodes of the best policy to film at the end, if the run has no films."""
    device: Literal["cpu", "cuda", "auto"] = "cpu"
    """Where networks run."""
    wandb: str | None = None
    """Project of Weights & Biases for the curves (WANDB_MODE=offline keeps them in the run)."""
    out: Path | None = None
    """Folder of the run; default: runs/TASK/TIME_sSEED."""
    resume: Path | None = None
    """Continue the run in this folder from its last checkpoint; only --steps and --films may be added."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Trains and says where the policy is."""
        from vispeg.core.errors import UserError

        if self.films < 0:
            raise UserError("must not be negative", key="--films", got=self.films)
        return self._train() if self.resume is None else self._resume(self.resume)

    def _train(self) -> int:
        from vispeg.api.train import new_run, train
        from vispeg.task.registry import with_tolerance
        from vispeg.task.world_file import load_world

        settings = {"stack": self.stack, "dof": self.dof or None, "reward": self.reward}
        settings |= with_tolerance(load_world(self.world).task if self.tolerance is not None else {}, self.tolerance)
        task = self.task or ""
        out = self.out or new_run(task, self.seed)
        with self._goes_on(out):
            trained = train(
                task,
                world=self.world,
                recipe=self.recipe,
                settings={key: value for key, value in settings.items() if value is not None},
                curriculum=self.curriculum,
                start_radius=self.start_radius,
                ranges=self.ranges,
                steps=100_000 if self.steps is None else self.steps,
                target=self.target,
                seed=self.seed,
                envs=self.envs,
                threads=self.threads,
                utd=self.utd,
                recurrent=self.recurrent,
                symmetric=self.symmetric,
                replay=self.replay,
                teacher=self.teacher,
                dataset=self.dataset,
                distill={"steps": self.distill_steps, "updates": self.distill_updates, "looks": self.distill_looks},
                every=self.every,
                episodes=self.episodes,
                device=self.device,
                wandb=self.wandb,
                out=out,
                show=not self.output.quiet,
            )
            self._tell(trained)
        return 0

    def _resume(self, folder: Path) -> int:
        from vispeg.api.train import resume
        from vispeg.core.errors import UserError

        others = [f for f in fields(self) if f.name not in ("resume", "steps", "films", "output")]
        changed = [f.name for f in others if getattr(self, f.name) != f.default]
        if changed:
            flags = {option.name: option.flag or option.name.upper() for option in options(type(self))}
            got = " ".join(flags[name] for name in changed)
            expected = "--steps and --films alone"
            raise UserError("a resumed run keeps its options", key="--resume", expected=expected, got=got)
        with self._goes_on(folder):
            self._tell(resume(folder, self.steps, show=not self.output.quiet))
        return 0

    def _goes_on(self, folder: Path) -> AbstractContextManager[None]:
        films = () if self.films == type(self).films else ("--films", str(self.films))
        return goes_on(instead=("train", "--resume", str(folder), *films))

    def _tell(self, trained: TrainedPolicy) -> None:
        """Says where the policy is, and films it unless that was done before."""
        from vispeg.api.films import films
        from vispeg.learn.envs import HELD_OUT

        if not self.output.json:
            self.output.give({}, trained.summary)
        made, place = list[dict[str, object]](), trained.run / "films"
        if self.films and not place.exists():
            seeds = [HELD_OUT + k for k in range(self.films)]
            for film in films(trained.best, trained.world, trained.settings, seeds, place, False):
                made.append(asdict(film))
                self.output.line(film.line)
        self.output.give({**trained.record, "films": made}, [])
