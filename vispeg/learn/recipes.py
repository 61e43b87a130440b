"""The recipes that begin with a teacher: `distill`, and `distill+sac` which goes on with reinforcement."""

# SB3 declares its networks and observations more widely than what stands in them here.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

import json
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.learn.config import TrainConfig
from vispeg.learn.distill import DistillSettings, distill
from vispeg.learn.envs import MakeEnv
from vispeg.learn.progress import Bar, Table
from vispeg.learn.replay import Replay
from vispeg.learn.teacher import Teacher, teacher_of
from vispeg.learn.train import SacRun, line

FROZEN = 5_000  # critic updates before a distilled actor moves: critics that know nothing yet would spoil it


def distilled(
    config: TrainConfig, folder: Path, make: MakeEnv | None, show: bool, teacher: Teacher | None = None
) -> Path:
    """Distils into a new folder, then reinforces if the recipe says so; returns the best policy's folder.

    Args:
        config: with `teacher` set, unless `teacher` is given.
        folder: of the run.
        make: environments; peg-in-hole if not given.
        show: whether to tell of progress on stderr.
        teacher: in place of the configuration's.

    Raises:
        UserError: there is no teacher, or it does not fit the task.
    """
    sac = replace(config.sac, warmup=0, actor_frozen=config.sac.actor_frozen or FROZEN)
    config = replace(config, sac=sac)
    if teacher is None and config.teacher is None:
        raise UserError("this recipe needs a teacher", key="teacher", expected="a state policy's folder, or expert")
    run = SacRun(config, folder, make, show)
    if teacher is None:
        teacher = teacher_of(str(config.teacher), run.env.env.config)  # type: ignore[attr-defined]
    folder.mkdir(parents=True, exist_ok=True)
    config.write(folder / "config.yaml")
    settings, started = distill_settings(config.distill), time.monotonic()
    table, bar = Table(folder / "progress.csv", 0), Bar(len(settings.betas), show)

    def tell(number: int, loss: float) -> None:
        row = run.row(run.evaluate(), time.monotonic() - started)
        row |= {"steps": (number + 1) * settings.steps, "stage": f"distill {number}", "actor_loss": loss}
        table.add(row)
        bar.say(line(row))
        run.keep_best(row)

    rings = distill(run.model.actor, run.modality.name, run.env, teacher, settings, config.seed, tell)
    run.model.new = False
    if config.recipe == "distill":
        return run.close()
    keep(rings[0], folder / "demos")
    run.model.demos = rings[0]
    return run.run()


def distill_settings(given: Any) -> DistillSettings:
    """Settings with some replaced. Raises UserError for an unknown key."""
    known = [f.name for f in fields(DistillSettings) if f.name != "clone"]
    for key in given:
        if key not in known:
            raise UserError("unknown key", key=f"distill.{key}", got=key, choices=known)
    own: dict[str, Any] = {key: tuple(value) if key == "betas" else value for key, value in given.items()}
    return DistillSettings(**own)


def keep(ring: Replay, folder: Path) -> None:
    """Stores demonstrations beside a run, so that it can go on from its checkpoint."""
    with new_folder(folder, overwrite=True) as place:
        ring.save(place)
        (place / "ring.json").write_text(json.dumps({"length": ring.length, "n_envs": ring.n_envs}) + "\n")


def kept(folder: Path, like: Replay) -> Replay:
    """The demonstrations that `keep` stored, for another ring's spaces. Raises UserError if they do not fit."""
    try:
        size = json.loads((folder / "ring.json").read_text(encoding="utf-8"))
        length, rows = int(size["length"]), int(size["n_envs"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError("not stored demonstrations", file=folder / "ring.json") from error
    ring = Replay(length * rows, like.observation_space, like.action_space, like.device, rows)
    ring.load(folder)
    return ring
