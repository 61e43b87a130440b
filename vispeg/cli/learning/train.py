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
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from vispeg.cli.options import changed
from vispeg.cli.output import Output, OutputOptions
from vispeg.cli.tolerance import Room
from vispeg.core.interrupt import goes_on

if TYPE_CHECKING:
    from vispeg.api.train import TrainedPolicy


UNPREFIXED = tyro.conf.OmitArgPrefixes  # of a group: its options keep their names, and help has its heading


@dataclass(frozen=True)
class Setting:
    """The task, and what an episode of it is."""

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


@dataclass(frozen=True)
class Learning:
    """How the policy learns, and on what."""

    recipe: Literal["sac", "distill", "distill+sac"] = "sac"
    """Reinforcement learning, imitation of a teacher, or imitation and then reinforcement."""
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
    device: Literal["cpu", "cuda", "auto"] = "cpu"
    """Where networks run."""
    utd: float | None = None
    """Critic updates per environment step."""
    recurrent: int = 0
    """Width of an LSTM in place of stacked observations; 0 for none."""
    symmetric: bool = False
    """Critics see what the actor sees, in place of ground truth (slower; for comparison)."""
    replay: int | None = None
    """Transitions kept in memory and in each checkpoint; default: 300000, with images 100000. The size is said at the
    start."""


@dataclass(frozen=True)
class Imitation:
    """Of the distill recipes; demonstrations also serve sac."""

    teacher: str | None = None
    """A policy's folder or name, or expert for the scripted one."""
    dataset: Path | None = None
    """Demonstrations in LeRobot's layout, as of `vispeg render`: in place of a teacher (distill), or half of each batch
    (sac). Only successful episodes count. FOLDER?action=KIND says what its actions are."""
    distill_steps: int = 4000
    """Environment steps of each of the five rounds."""
    distill_updates: int = 2000
    """Gradient steps after each round."""
    distill_looks: int = 1
    """Looks in which each state is stored: the episode's own and others."""


@dataclass(frozen=True)
class Judging:
    """How the policy is judged on the way, and shown at the end."""

    every: int = 5000
    """Environment steps between evaluations and checkpoints."""
    episodes: int = 50
    """Episodes of an evaluation."""
    films: int = 2
    """Episodes of the best policy to film at the end, if the run has no films."""
    wandb: str | None = None
    """Project of Weights & Biases for the curves (WANDB_MODE=offline keeps them in the run)."""


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg train`."""

    task: tyro.conf.Positional[str | None] = None
    """The task and what the policy sees, such as LABEL-depth; not needed with --resume."""
    out: Path | None = None
    """Folder of the run; default: runs/TASK/TIME_sSEED."""
    resume: Path | None = None
    """Continue the run in this folder from its last checkpoint; only --steps and --films may be added."""
    setting: Annotated[Setting, tyro.conf.arg(name="task"), UNPREFIXED] = Setting()
    learning: Annotated[Learning, tyro.conf.arg(name="learning"), UNPREFIXED] = Learning()
    imitation: Annotated[Imitation, tyro.conf.arg(name="imitation"), UNPREFIXED] = Imitation()
    judging: Annotated[Judging, tyro.conf.arg(name="evaluation"), UNPREFIXED] = Judging()
    output: OutputOptions = Output()

    def run(self) -> int:
        """Trains and says where the policy is."""
        from vispeg.core.errors import UserError

        if self.judging.films < 0:
            raise UserError("must not be negative", key="--films", got=self.judging.films)
        return self._train() if self.resume is None else self._resume(self.resume)

    def _train(self) -> int:
        from vispeg.api.train import new_run, train
        from vispeg.task.registry import with_tolerance
        from vispeg.task.world_file import load_world

        settings = {"stack": self.setting.stack, "dof": self.setting.dof or None, "reward": self.setting.reward}
        settings |= with_tolerance(
            load_world(self.setting.world).task if self.setting.tolerance is not None else {}, self.setting.tolerance
        )
        task = self.task or ""
        out = self.out or new_run(task, self.learning.seed)
        with self._goes_on(out):
            trained = train(
                task,
                world=self.setting.world,
                recipe=self.learning.recipe,
                settings={key: value for key, value in settings.items() if value is not None},
                curriculum=self.setting.curriculum,
                start_radius=self.setting.start_radius,
                ranges=self.setting.ranges,
                steps=100_000 if self.learning.steps is None else self.learning.steps,
                target=self.learning.target,
                seed=self.learning.seed,
                envs=self.learning.envs,
                threads=self.learning.threads,
                utd=self.learning.utd,
                recurrent=self.learning.recurrent,
                symmetric=self.learning.symmetric,
                replay=self.learning.replay,
                teacher=self.imitation.teacher,
                dataset=self.imitation.dataset,
                distill={
                    "steps": self.imitation.distill_steps,
                    "updates": self.imitation.distill_updates,
                    "looks": self.imitation.distill_looks,
                },
                every=self.judging.every,
                episodes=self.judging.episodes,
                device=self.learning.device,
                wandb=self.judging.wandb,
                out=out,
                show=not self.output.quiet,
            )
            self._tell(trained)
        return 0

    def _resume(self, folder: Path) -> int:
        from vispeg.api.train import resume
        from vispeg.core.errors import UserError

        if others := changed(self, besides=("resume", "steps", "films", "json", "quiet")):
            got = " ".join(option.flag or option.name.upper() for option in others)
            expected = "--steps and --films alone"
            raise UserError("a resumed run keeps its options", key="--resume", expected=expected, got=got)
        with self._goes_on(folder):
            self._tell(resume(folder, self.learning.steps, show=not self.output.quiet))
        return 0

    def _goes_on(self, folder: Path) -> AbstractContextManager[None]:
        films = () if self.judging.films == Judging.films else ("--films", str(self.judging.films))
        return goes_on(instead=("train", "--resume", str(folder), *films))

    def _tell(self, trained: TrainedPolicy) -> None:
        """Says where the policy is, and films it unless that was done before."""
        from vispeg.api.films import films
        from vispeg.learn.envs import HELD_OUT

        if not self.output.json:
            self.output.give({}, trained.summary)
        made, place = list[dict[str, object]](), trained.run / "films"
        if self.judging.films and not place.exists():
            seeds = [HELD_OUT + k for k in range(self.judging.films)]
            for film in films(trained.best, trained.world, trained.settings, seeds, place, False):
                made.append(asdict(film))
                self.output.line(film.line)
        self.output.give({**trained.record, "films": made}, [])
