"""Train a policy, as `vispeg train` does."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from vispeg.api.policies import load_policy
from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.core.paths import expanded
from vispeg.report.text.summary import Block, Line, Summarised
from vispeg.sim.engine import Engine

if TYPE_CHECKING:
    from vispeg.learn.policy import Policy


@dataclass(frozen=True)
class TrainedPolicy(Summarised):
    """A training run on disk.

    Attributes:
        run: folder of the run: config.yaml, progress.csv, tensorboard/, checkpoints/.
        best: folder of the policy that was best in the run's evaluations.
        world: name or file of the training world.
        settings: fields of the task's configuration that replace the world's.
    """

    run: Path
    best: Path
    world: str
    settings: Mapping[str, Any]

    def open(self) -> Policy:
        """Load the best policy."""
        return load_policy(self.best)

    @property
    def history(self) -> list[dict[str, str]]:
        """The run's evaluations in order, as rows of progress.csv: column -> text; see docs/learning.md."""
        from vispeg.learn.curves.progress import Table

        return Table(self.run / "progress.csv", sys.maxsize).rows

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg train --json`, except the videos that only the command makes."""
        return {"run": str(self.run), "best": str(self.best)}

    @property
    def summary(self) -> list[Block]:
        """Success rate of the run's last evaluation, and folder of the best policy."""
        last = [f"success {float(row['success']):.0%} after {row['steps']} steps" for row in self.history[-1:]]
        return [*(Line(text) for text in last), Line(f"best policy: {self.best}", path=True)]


def new_run(task: str, seed: int) -> Path:
    """Return the default folder for a run that begins now."""
    return Path("runs") / task / f"{time.strftime('%Y%m%d-%H%M%S')}_s{seed}"


def train(
    task: str,
    *,
    world: str | Path = "nominal",
    recipe: Literal["sac", "distill", "distill+sac"] = "sac",
    settings: Mapping[str, Any] | None = None,
    curriculum: Sequence[float] = (),
    start_radius: Sequence[float] = (),
    ranges: Literal["full", "schedule", "adaptive"] = "full",
    steps: int | None = None,
    target: float = 0.995,
    seed: int = 0,
    envs: int = 16,
    threads: int = 1,
    engine: Engine = "c",
    utd: float | None = None,
    recurrent: int = 0,
    symmetric: bool = False,
    replay: int | None = None,
    teacher: str | Path | None = None,
    dataset: str | Path | None = None,
    distill: Mapping[str, int] | None = None,
    every: int = 5000,
    episodes: int = 50,
    device: Literal["cpu", "cuda", "auto"] = "cpu",
    wandb: str | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    show: bool = False,
) -> TrainedPolicy:
    """Train a policy for the task of a world; see docs/learning.md.

    If `out` holds a stopped run of the same configuration, that run is continued, unless it is to be replaced.

    Args:
        task: label of the world's task, a hyphen and what the policy observes, such as LABEL-depth; not needed with
            `resume`.
        world: a built-in world's name or a world file.
        recipe: reinforcement learning, imitation of a teacher, or imitation and then reinforcement.
        settings: fields of the task's configuration that replace the world's, such as `stack`, `dof`, `reward`.
        curriculum: tolerances of easier stages before the task itself, mm, widest first; a stage ends at 80 % success.
        start_radius: lateral distances from the goal within which episodes of these stages start, m, nearest first.
        ranges: how far the world's ranges extend: fully from the first step (full), further and further over the first
            half of the steps (schedule), or each range as far as the policy succeeds in it (adaptive).
        steps: total number of environment steps of reinforcement learning; default: 100000. With `resume`: the new
            total.
        target: success rate that ends imitation or reinforcement early if two successive evaluations reach it; 2 is
            never reached.
        seed: seed of networks, exploration and episodes.
        envs: number of environments in one batch.
        threads: number of threads for physics and for networks.
        engine: physics of training: c, or warp for MuJoCo Warp on a GPU, for imitation of a teacher. Evaluations are on
            c.
        utd: number of critic updates per environment step.
        recurrent: width of an LSTM in place of stacked observations; 0 for none.
        symmetric: let critics observe what the actor observes, in place of ground truth (slower; for comparison).
        replay: number of transitions kept in memory and in each checkpoint; default: 300000, with images 100000. Their
            size is printed at the start.
        teacher: a policy's folder or name, or `expert` for the scripted one.
        dataset: demonstrations in LeRobot's layout, such as by `vispeg render`, in place of a teacher (distill), or as
            half of each batch (sac). Only successful episodes are used. FOLDER?action=KIND states the kind of its
            actions.
        distill: settings of the imitation that replace the defaults, such as `steps` and `updates` of each round, and
            `looks`, the number of looks (draws of what only cameras see) in which each state is stored; the recipe
            `sac` ignores them.
        every: environment steps between evaluations and checkpoints.
        episodes: number of episodes of an evaluation.
        device: where networks run.
        wandb: project of Weights & Biases for the curves (WANDB_MODE=offline keeps them in the run's folder).
        out: folder of the run; default: runs/TASK/TIME_sSEED.
        overwrite: replace the run in `out`; it is kept until the new run has a checkpoint.
        show: show progress on standard error.

    Raises:
        UserError: no such world or teacher, `task` is not the world's, an impossible number, or `out` holds anything
            but a stopped run of this configuration.
    """
    if engine != "c":
        require("mujoco_warp", f"--engine {engine}")
    if wandb is not None:  # before torch is imported, so that a missing wandb is reported at once
        require("wandb", "--wandb")
    require("torch", "training")
    from vispeg.learn import train as running
    from vispeg.learn.config import TrainConfig
    from vispeg.learn.methods.curriculum import stages
    from vispeg.learn.modalities import modality
    from vispeg.learn.settings import defaults
    from vispeg.task.environments.vector import world_of

    if recipe == "distill" and steps is not None:
        expected = "--distill-steps, the steps of each round"
        raise UserError("imitation alone goes by rounds", key="--steps", expected=expected, got=steps)
    chosen = dict(settings or {})
    if recurrent and chosen.get("stack") not in (None, 1):
        expected = "one of them, as the LSTM replaces the stack"
        raise UserError("an LSTM and stacked observations", key="--stack", expected=expected, got=chosen["stack"])
    world = str(world)
    task_config = world_of(world, dict(chosen))[1]
    sees_images = bool(modality(_modality_name(task, task_config, world)).kinds)
    sac = defaults(sees_images)
    sac = replace(sac, recurrent=recurrent, utd=sac.utd if utd is None else utd, symmetric=symmetric)
    sac = sac if replay is None else replace(sac, replay=replay)
    config = TrainConfig(
        task,
        recipe,
        world,
        100_000 if steps is None else steps,
        seed,
        envs,
        every,
        episodes,
        target,
        stages=stages(curriculum, start_radius, task_config),
        settings=chosen,
        sac=sac,
        teacher=None if teacher is None else str(teacher),
        dataset=None if dataset is None else str(dataset),
        distill={} if recipe == "sac" else dict(distill or {}),
        device=device,
        threads=threads,
        engine=engine,
        ranges=ranges,
        wandb=wandb or "",
    )
    folder = new_run(task, seed) if out is None else expanded(out)
    return TrainedPolicy(folder, running.train(config, folder, show=show, overwrite=overwrite), world, chosen)


def resume(run: str | Path, steps: int | None = None, *, show: bool = False) -> TrainedPolicy:
    """Continue a run from its last checkpoint, exactly as if it had not stopped.

    Args:
        run: folder of the run.
        steps: new total number of steps; by default that of the run.
        show: show progress on standard error.

    Raises:
        UserError: `run` holds no run, its last checkpoint is missing or damaged, or another process trains in it; or
            `steps` is given but the run has done more, ended at its target, or only imitates.
    """
    require("torch", "training")
    from vispeg.learn import train as running
    from vispeg.learn.config import read_config

    folder = expanded(run)
    best = running.resume(folder, steps, show=show)
    config = read_config(folder / "config.yaml")
    return TrainedPolicy(folder, best, config.world, config.settings)


def _modality_name(task: str, task_config: Any, world: str) -> str:
    """Return the name of the modality in `task`, a text LABEL-MODALITY.

    Raises:
        UserError: `task` has no hyphen, or its label is not that of the world's task.
    """
    from vispeg.learn.modalities import names
    from vispeg.task.registry import task_of

    label, _, name = task.partition("-")
    expected = task_of(task_config).label
    if not name or label != expected:
        raise UserError(f"the world {world} has no such task", got=task, choices=[f"{expected}-{m}" for m in names()])
    return name
