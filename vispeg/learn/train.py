"""Start or resume a training run."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.files import recover, set_aside
from vispeg.core.lock import LOCK, claimed
from vispeg.core.notes import note
from vispeg.learn.config import TrainConfig, read_config
from vispeg.learn.curves.progress import Table
from vispeg.learn.envs import MakeEnv
from vispeg.learn.methods.recipes import distilled
from vispeg.learn.methods.rounds import ROUNDS
from vispeg.learn.methods.sac_run import SacRun
from vispeg.learn.run_folder import begin, is_distilled, is_kept, refuse_other, same_run


def train(
    config: TrainConfig, folder: Path, make: MakeEnv | None = None, show: bool = True, overwrite: bool = False
) -> Path:
    """Train by the configuration's recipe into a new folder; return the best policy's folder.

    If the folder holds a stopped run of the same configuration, that run is resumed, unless `overwrite` is True.

    Args:
        config: the run's configuration.
        folder: the run's folder.
        make: makes the environments; None for those of the configuration's world.
        show: whether to print progress to stderr.
        overwrite: whether a run in the folder is replaced; it is kept until the new one has something to keep.

    Raises:
        UserError: the folder holds something else, the configuration cannot be run, or another process trains there.
    """
    with claimed(folder):
        _recover(folder)
        if not folder.exists() or (folder.is_dir() and {p.name for p in folder.iterdir()} <= {LOCK}):
            return _begin(config, folder, make, show)
        if overwrite:
            refuse_other(config, folder)
            with set_aside(folder, lambda: is_kept(folder)):
                return _begin(config, folder, make, show)
        if folder.is_file() or not same_run(config, folder):
            expected = "another folder, --resume to continue the run there, or --overwrite to replace it"
            raise UserError("exists already", file=folder, expected=expected)
        if (folder / "config.yaml").exists():  # missing where a full disk stopped the run early
            return resume(folder, make=make, show=show)
        return _begin(config, folder, make, show)


def _recover(folder: Path) -> None:
    """Put a run back that `overwrite` put aside, unless the one that replaces it has something to keep."""
    if recover(folder.resolve(), lambda: is_kept(folder)):
        note(
            f"{folder}: the run that --overwrite was to replace is back, as the new one was killed too early to be kept"
        )


def _begin(config: TrainConfig, folder: Path, make: MakeEnv | None, show: bool) -> Path:
    if config.recipe != "sac":
        return distilled(config, folder, make, show)
    run = SacRun(config, folder, make, show)
    begin(config, folder)
    return run.run()


def resume(folder: Path, steps: int | None = None, make: MakeEnv | None = None, show: bool = True) -> Path:
    """Resume the run in a folder; return the best policy's folder.

    A run that was stopped before its first checkpoint starts again; a finished one is not trained further without more
    steps.

    Args:
        folder: the run's folder.
        steps: new total of environment steps; None for that of the run's configuration.
        make, show: see `train`.

    Raises:
        UserError: there is no run, its last checkpoint is missing or damaged, or another process trains there; or
            `steps` is given but the run has done more, ended at its target, or only imitates.
    """
    if folder.resolve().parent.is_dir():  # else the lock would make it
        with claimed(folder):
            _recover(folder)  # before anything is read: the run may have been put aside
    config = read_config(folder / "config.yaml")
    if steps is not None and config.recipe == "distill":
        expected = "a new run, with more --distill-steps or of the recipe distill+sac"
        raise UserError("imitation goes by rounds", file=folder, key="--steps", expected=expected, got=steps)
    with claimed(folder):
        asked = config if steps is None else replace(config, steps=steps)
        last = folder / "checkpoints" / "last"
        if last.parent.is_dir():
            recover(last)
        if not last.is_dir():
            if config.recipe == "distill" and is_distilled(folder):
                return folder / "checkpoints" / "best"
            if config.recipe == "sac" and len(Table(folder / "progress.csv", sys.maxsize).rows) > 1:
                raise UserError("there is no checkpoint to resume from", file=last)
            if steps is not None:
                asked.write(folder / "config.yaml")
            return _begin(asked, folder, make, show)
        run = SacRun(asked, folder, make, show)
        run.resume()
        if steps is not None:  # only after the checkpoint was read: a damaged one leaves the folder as it was
            _check_goes_on(run, steps)
            asked.write(folder / "config.yaml")
        best = run.run()
        shutil.rmtree(folder / ROUNDS, ignore_errors=True)  # left by a run that was killed after its distillation
        return best


def _check_goes_on(run: SacRun, steps: int) -> None:
    """Raise UserError for a run that was restored and does not train on to `steps`, or has more of them."""
    if run.ended:
        expected = "a new run with a higher --target; 2 is never reached"
        what = f"the run ended at its target: success of {run.config.target:g} or more, twice in a row"
        raise UserError(what, file=run.folder, key="--steps", expected=expected, got=steps)
    if steps < (done := run.model.num_timesteps):
        raise UserError("the run has more steps", file=run.folder, key="--steps", expected=f">= {done}", got=steps)
