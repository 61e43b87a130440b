"""The recipes that begin with a teacher or a dataset: `distill`, and `distill+sac`, which then reinforces with SAC."""

# SB3 declares wider types for its networks and observations than those used here.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

import shutil
import sys
import time
from dataclasses import fields
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.demonstrations.looks import check
from vispeg.learn.config import TrainConfig
from vispeg.learn.curves.loggers import curves, record
from vispeg.learn.curves.progress import Bar, Table
from vispeg.learn.envs import MakeEnv
from vispeg.learn.experience.shown import from_folder
from vispeg.learn.methods.distill import DistillSettings, distill, imitate
from vispeg.learn.methods.rounds import ROUNDS, RoundResult, Rounds, keep_ring
from vispeg.learn.methods.sac_run import SacRun, line
from vispeg.learn.run_folder import begin, settled
from vispeg.learn.teacher import Teacher, teacher_of


def distilled(
    config: TrainConfig, folder: Path, make: MakeEnv | None, show: bool, teacher: Teacher | None = None
) -> Path:
    """Distil, then train with SAC if the recipe says so; return the best policy's folder.

    Rounds that a killed distillation has finished in the folder are not repeated.

    Args:
        config: the run's configuration; it must name `teacher` or `dataset`, unless `teacher` is passed.
        folder: the run's folder.
        make: makes the environments; None for those of the configuration's world.
        show: whether to print progress to stderr.
        teacher: replaces the configuration's teacher.

    Raises:
        UserError: there is neither teacher nor dataset, or it does not fit the task.
    """
    config = settled(config)
    if teacher is None and config.teacher is None and config.dataset is None:
        expected = "a state policy's folder, or expert; or a dataset"
        raise UserError("this recipe needs a teacher", key="teacher", expected=expected)
    run = SacRun(config, folder, make, show)
    settings = distill_settings(config.distill)
    actor, modality, demonstrated = run.model.actor, run.modality.name, None
    if config.dataset is not None:
        if settings.looks > 1:
            raise UserError("the looks of a dataset are fixed", key="looks", expected=1, got=settings.looks)
        told: Any = {
            "config": getattr(run.env.env, "config", None),
            "say": lambda text: print(text, file=sys.stderr) if show else None,
        }
        demonstrated = from_folder(config.dataset, modality, actor.layout, config.seed, actor.device, **told)
    else:
        check(run.env.env, settings.looks)
        teacher = teacher or teacher_of(str(config.teacher), run.env.env.config)
    begin(config, folder)
    rounds = Rounds(folder / ROUNDS, run.model.replay)
    before: RoundResult = rounds.state or {}
    if "best" in before and "command" in before:
        run.best, run.command = (before["best"][0], before["best"][1]), before["command"]
    reached = int(before.get("reached", 0))  # number of latest rounds in a row that reached the target
    table = Table(folder / "progress.csv", 0, rounds.done)
    logger = curves(folder, config)
    bar, started = Bar(len(settings.betas), show), time.monotonic() - table.seconds

    def tell(number: int, loss: float) -> RoundResult:
        nonlocal reached
        row = run.row(run.evaluate(), time.monotonic() - started)
        row["updates"], row["stage"], row["actor_loss"] = (number + 1) * settings.updates, f"distill {number}", loss
        row["steps"] = (number + 1) * settings.steps if demonstrated is None else 0
        table.add(row)
        record(logger, row, "distill", row["updates"])
        bar.say(line(row))
        run.keep(row)
        reached = reached + 1 if row["success"] >= config.target else 0
        return {"best": list(run.best), "command": run.command, "reached": reached, "stop": reached >= 2}

    if demonstrated is not None:
        imitate(actor, demonstrated, settings, config.seed, tell, rounds)
    elif teacher is not None:
        demos = distill(actor, modality, run.env, teacher, settings, config.seed, tell, rounds)[0]
        if config.recipe == "distill+sac":
            keep_ring(demos, folder / "demos")
            run.model.demos = demos
    run.model.new = False
    logger.close()
    best = run.close() if config.recipe == "distill" else run.run()
    shutil.rmtree(folder / ROUNDS)
    return best


def distill_settings(overrides: Any) -> DistillSettings:
    """Return DistillSettings with these values replaced. Raises UserError for an unknown key."""
    choices = [f.name for f in fields(DistillSettings) if f.name != "clone"]
    for key in overrides:
        if key not in choices:
            raise UserError("unknown key", key=f"distill.{key}", got=key, choices=choices)
    return DistillSettings(**{key: tuple(value) if key == "betas" else value for key, value in overrides.items()})
