"""The folder of a training run before its first checkpoint, so that a run stopped that early can be resumed too."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import yaml

from vispeg.core.errors import UserError
from vispeg.core.files import refuse, write_text_atomic
from vispeg.core.lock import LOCK
from vispeg.core.provenance import command_line
from vispeg.learn.config import TrainConfig, read_config
from vispeg.learn.methods.rounds import ROUNDS, STATE

BEGUN = "begun.json"
# everything that a run's folder may hold
WRITTEN = {"config.yaml", BEGUN, "progress.csv", "tensorboard", "checkpoints", ROUNDS, "demos", "diverged", "films"}
WRITTEN |= {"wandb", "wandb.json", LOCK}
FROZEN = 5_000  # critic updates before a distilled actor is updated: untrained critics would spoil it


def settled(config: TrainConfig) -> TrainConfig:
    """Return the configuration as written to the run's folder.

    Recipes that begin with imitation have no random actions, and their actor is frozen at first (FROZEN).
    """
    if config.recipe == "sac":
        return config
    return replace(config, sac=replace(config.sac, warmup=0, actor_frozen=config.sac.actor_frozen or FROZEN))


def begin(config: TrainConfig, folder: Path) -> None:
    """Make a run's folder and write config.yaml; delete curves of a run stopped before a checkpoint or a round."""
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / "tensorboard").is_dir() and not (folder / ROUNDS / STATE).exists():
        shutil.rmtree(folder / "tensorboard", ignore_errors=True)
    if begun_by(folder) is None:
        text = json.dumps({"command": command_line(sys.argv)}) + "\n"
        write_text_atomic(folder / BEGUN, text, overwrite=True)
    config.write(folder / "config.yaml")
    if config.recipe != "sac":
        (folder / ROUNDS).mkdir(exist_ok=True)


def begun_by(folder: Path) -> str | None:
    """Return the command that began the run in a folder; None where that is not known."""
    try:
        return str(json.loads((folder / BEGUN).read_text(encoding="utf-8"))["command"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def same_run(config: TrainConfig, folder: Path) -> bool:
    """Return whether the folder holds a run of this very configuration, or one stopped before it wrote config.yaml."""
    if {path.name for path in folder.iterdir()} <= {BEGUN}:
        return True
    try:
        there, here = read_config(folder / "config.yaml"), settled(config)
    except UserError:
        return False
    return yaml.safe_load(there.text()) == yaml.safe_load(here.text())  # both with lists in place of tuples


def refuse_other(config: TrainConfig, folder: Path) -> None:
    """Raise UserError unless a folder may be replaced: it holds a run alone, which `config` does not read."""
    refuse(folder, True, holds=None, inputs=(config.world, config.teacher, config.dataset))
    names = {path.name for path in folder.iterdir()}
    if not names & {BEGUN, "config.yaml"} or names - WRITTEN:
        others = ", ".join(sorted(names - WRITTEN)[:3])
        why = f" (it holds {others})" if others else ""
        raise UserError(f"is not a folder of such results{why}", file=folder, expected="a run of `vispeg train` alone")


def is_kept(folder: Path) -> bool:
    """Return whether the run in a folder has a checkpoint or a round, from which it can go on."""
    return any(folder.glob("checkpoints/*")) or (folder / ROUNDS / STATE).exists()


def is_distilled(folder: Path) -> bool:
    """Return whether the distillation in a run's folder is finished."""
    return not (folder / ROUNDS).is_dir() and (folder / "checkpoints" / "best").is_dir()
