"""The recipes that begin with imitation of a teacher or a dataset: `distill`, and `distill+sac`, followed by SAC."""

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
    """Train by imitation, and then with SAC if the recipe is `distill+sac`; return the best policy's folder.

    If the folder holds a killed run, its finished rounds of imitation are not repeated.

    Args:
        config: the run's configuration. If it names a dataset, that is imitated, else the teacher.
        folder: the run's folder.
        make: makes the environments; None for those of the configuration's world.
        show: whether to print progress to stderr.
        teacher: used in place of the configuration's teacher.

    Raises:
        UserError: there is neither teacher nor dataset, it does not fit the task, or `looks` is above 1 for a dataset
            or where all looks would be equal; or reinforcement is to follow a first round in which not the teacher
            alone acts.
    """
    config = settled(config)
    if teacher is None and config.teacher is None and config.dataset is None:
        expected = "the folder of a policy that knows the goal, or expert"
        raise UserError("this recipe needs a teacher or a dataset", key="teacher", expected=expected)
    run = SacRun(config, folder, make, show)
    settings = distill_settings(config.distill)
    actor, modality, demonstrated = run.model.actor, run.modality.name, None
    if config.dataset is not None:
        if settings.looks > 1:
            raise UserError("the looks of a dataset are fixed", key="looks", expected=1, got=settings.looks)
        demonstrated = from_folder(
            config.dataset,
            modality,
            actor.layout,
            config.seed,
            actor.device,
            config=getattr(run.env.env, "config", None),
            say=lambda text: print(text, file=sys.stderr) if show else None,
        )
    else:
        if config.recipe == "distill+sac" and settings.betas[0] < 1:
            # labels are the actions of its transitions only where nobody but the teacher acts
            what = "reinforcement draws from the first round, in which the teacher alone must act"
            raise UserError(what, key="distill.betas", expected="1 first", got=settings.betas)
        check(run.env.env, settings.looks)
        teacher = teacher or teacher_of(str(config.teacher), run.env.env.config)
    begin(config, folder)
    rounds = Rounds(folder / ROUNDS, run.model.replay)
    stored: RoundResult = rounds.state or {}
    if "best" in stored and "command" in stored:
        run.best, run.command = (stored["best"][0], stored["best"][1]), stored["command"]
    reached = int(stored.get("reached", 0))  # number of the latest consecutive rounds that reached the target
    table = Table(folder / "progress.csv", 0, rounds.done)
    logger = curves(folder, config)
    bar, started = Bar(len(settings.betas), show), time.monotonic() - table.seconds

    def evaluate(number: int, loss: float) -> RoundResult:
        """Evaluate the student after a round, keep it if it is the best, and return the round's result."""
        nonlocal reached
        row = run.row(run.evaluate(), time.monotonic() - started)
        row["updates"], row["stage"], row["actor_loss"] = (number + 1) * settings.updates, f"distill {number}", loss
        row["steps"] = (number + 1) * settings.steps if demonstrated is None else 0
        table.add(row)
        record(logger, row, "distill", row["updates"])
        bar.say(line(row))
        run.keep(row, f"updates-{row['updates']}", run.course.last)
        reached = reached + 1 if row["success"] >= config.target else 0
        return {"best": list(run.best), "command": run.command, "reached": reached, "stop": reached >= 2}

    if demonstrated is not None:
        imitate(actor, demonstrated, settings, config.seed, evaluate, rounds)
    elif teacher is not None:
        first, *_ = distill(actor, modality, run.env, teacher, settings, config.seed, evaluate, rounds)
        if config.recipe == "distill+sac":
            keep_ring(first, folder / "demos")
            run.model.demos = first
    run.model.new = False  # SAC keeps the input scales of the trained actor
    logger.close()
    best = run.close() if config.recipe == "distill" else run.run()
    shutil.rmtree(folder / ROUNDS)
    return best


def distill_settings(overrides: Any) -> DistillSettings:
    """Return the default DistillSettings with some values replaced.

    Args:
        overrides: mapping of a setting's name to its value; `clone` cannot be replaced.

    Raises:
        UserError: an unknown name, or an impossible value.
    """
    choices = [f.name for f in fields(DistillSettings) if f.name != "clone"]
    for key in overrides:
        if key not in choices:
            raise UserError("unknown key", key=f"distill.{key}", got=key, choices=choices)
    return DistillSettings(**{key: tuple(value) if key == "betas" else value for key, value in overrides.items()})
