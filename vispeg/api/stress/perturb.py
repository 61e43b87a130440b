"""`vispeg perturb`: play policies at hard positions, with and without pushes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from vispeg.api.playing import Playing, check_numbers, folders, play, silent, stamped
from vispeg.api.stress.result import Stressed
from vispeg.core.cluster import Engine
from vispeg.core.errors import UserError
from vispeg.evaluation.entrants import Policies
from vispeg.evaluation.folder import EPISODES, workplace
from vispeg.evaluation.jobs import Pushes, make_jobs, seeds_of
from vispeg.evaluation.players import ready
from vispeg.evaluation.runner import names_of
from vispeg.evaluation.stress import perturb as pushed
from vispeg.report.gap import words
from vispeg.report.gap.stress_pages import perturb_page
from vispeg.report.text.summary import Block
from vispeg.report.text.tables import Column, Sheet
from vispeg.task.registry import config_of, task_of
from vispeg.task.world_file import load_world

HEADS = ("policy", "position", "still", "pushed", "change by the push, points", "verdict")


class PerturbResult(Stressed):
    """Success at every position without and with pushes on the same seeds, and the loss by pushes; see `Played`."""

    command = holds = "perturb"

    @property
    def summary(self) -> list[Block]:
        """One row per policy and position."""
        return [Sheet([Column(head) for head in HEADS], [_row(r) for r in self.record["rows"]])]

    def _render(self) -> str:
        return perturb_page(self.record)


def perturb(
    policies: Policies,
    world: str | Path = "randomized",
    *,
    episodes: int = 40,
    force: tuple[float, float] = (20.0, 60.0),
    duration: float = 0.2,
    positions: str | Path | None = None,
    task: Mapping[str, Any] | None = None,
    seed: int = 0,
    workers: int = 1,
    engine: Engine = "local",
    out: str | Path | None = None,
    overwrite: bool = False,
    playing: Playing = silent,
) -> PerturbResult:
    """Play policies at the hard positions of the world's task, or at those of a file.

    Args:
        policies, task, seed, workers, engine, out, overwrite, playing: as in `vispeg.evaluate`.
        world: a built-in world's name or a world file.
        episodes: number of episodes at each position, and as many with pushes.
        force: range of the pushes, N.
        duration: duration of a push, s.
        positions: a file of positions, `format: vispeg-positions/1`; default: the task's.

    Raises:
        UserError: as for `vispeg.evaluate`, or an impossible push or list of positions.
    """
    check_numbers(episodes, workers)
    if not 0 <= force[0] <= force[1]:
        raise UserError("not a push", key="--force", expected="0 <= low <= high", got=force)
    if not duration > 0:
        raise UserError("not a push", key="--duration", expected="above 0 s", got=duration)
    who, file = ready(policies), load_world(world)
    listed = None if positions is None else Path(positions)
    hard = pushed.positions(listed, task_of(config_of(file.task)))
    pushed.check(hard, listed, file)
    read = [file.path, *([] if listed is None else [listed]), *folders(who)]
    with workplace(out, "perturb.json", overwrite, read) as place:
        settings = pushed.settings(str(world), file.name, hard, Pushes(force, duration))
        settings = [replace(s, task={**s.task, **(task or {})}) for s in settings]
        ends = play(
            make_jobs(who, settings, seeds_of(episodes, seed), place / "worlds"), place, workers, playing, engine
        )
        about = {"world": {"name": file.name, "hash": file.hash}, "force": force, "duration": duration}
        record = stamped({**pushed.summarise(ends), **about}, seed, folders(who))
        result = PerturbResult(record, tuple(ends), (), tuple(read), names_of(place / EPISODES))
        if out is not None:
            result._write(place)
    return result


def _row(r: Mapping[str, Any]) -> list[str]:
    rates = ["-" if r[k] is None else words.rate(r[k]) for k in ("still", "pushed")]
    cost = "-" if r["cost"] is None else words.change(r["cost"])
    return [r["policy"], r["position"], *rates, cost, r["verdict"] or "-"]
