"""Shared parts of evaluations: play jobs with a progress display, and save results of episodes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from vispeg.api.result import Result
from vispeg.core.cluster import Engine
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.core.paths import expanded
from vispeg.core.provenance import here
from vispeg.core.several import several
from vispeg.evaluation import runner
from vispeg.evaluation.controls import controls_of
from vispeg.evaluation.entrants import Entrant
from vispeg.evaluation.folder import workplace
from vispeg.evaluation.jobs import Job
from vispeg.evaluation.records import Episode, append
from vispeg.learn.record import policy_digest
from vispeg.report.gap import words
from vispeg.report.gap.build import write
from vispeg.task.registry import config_of, scene_of
from vispeg.task.world_file import WorldFile

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NO_CONTROL = "none"
Playing = Callable[[Sequence[Job], Path], AbstractContextManager[runner.Watch]]


def silent(jobs: Sequence[Job], folder: Path) -> AbstractContextManager[runner.Watch]:
    """Provide a progress display that shows nothing."""
    return nullcontext(lambda new, done, total: None)


@dataclass(frozen=True, repr=False)
class Played(Result):
    """A result of played episodes.

    Attributes:
        record: content of the JSON file, see docs/reference/keys.md.
        episodes: all episodes, see `vispeg.evaluation.records.Episode`.
        media: videos of some episodes; empty without a folder of results.
        sources: files and folders that were read.
        names: hashes behind the names of policies and worlds, see `vispeg.evaluation.runner.names_of`.
    """

    record: Mapping[str, Any]
    episodes: tuple[Episode, ...] = field(repr=False)
    media: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)
    sources: tuple[str | Path, ...] = ()
    names: runner.Names = field(default_factory=runner.names_of, repr=False)
    command: ClassVar[str]

    def plot(self) -> Figure:
        """Draw the success of every policy in every world with its 95 % interval; see `Result.plot`."""
        from vispeg.report.drawings.figures import BEFORE, RULE, WIDE, new_figure, styled

        rows = self.record["success"]
        with styled(WIDE):
            figure = new_figure(0.9 + 0.28 * len(rows), WIDE.width)
            axes = figure.add_subplot()
            for y, row in enumerate(rows):
                value, low, high = (100 * row["success"][key] for key in ("value", "low", "high"))
                axes.plot([low, high], [y, y], color=BEFORE, linewidth=2)
                axes.plot(value, y, "o", color=BEFORE)
            axes.set_yticks(range(len(rows)), [f"{words.name(r)} in {r['world']}" for r in rows])
            axes.set(xlim=(-2, 102), ylim=(len(rows) - 0.5, -0.5), xlabel="success, % of episodes, with 95 % interval")
            axes.grid(axis="x", color=RULE, linewidth=0.5)
        return figure

    def save(self, out: str | Path, *, overwrite: bool = False) -> Path:
        """Write record, page and episodes into a folder; see `Result.save`."""
        with workplace(out, f"{self.command}.json", overwrite, self.sources) as place:
            (place / runner.EPISODES).unlink(missing_ok=True)
            append(place / runner.EPISODES, self.episodes)
            write_text_atomic(place / runner.RUN, runner.text_of(self.names), overwrite=True)
            self._write(place)
        return expanded(out)

    def _write(self, folder: Path) -> None:
        """Write the record, the list of videos and the page, beside the episodes."""
        write_text_atomic(folder / "media.json", json.dumps(self.media) + "\n", overwrite=True)
        text = json.dumps(self.record, indent=1, allow_nan=False) + "\n"
        write_text_atomic(folder / f"{self.command}.json", text, overwrite=True)
        write(folder, self.command, overwrite=True)


def play(jobs: Sequence[Job], folder: Path, workers: int, playing: Playing, engine: Engine = "local") -> list[Episode]:
    """Play the jobs and return all their episodes; those saved in `folder` are not played again."""
    with playing(jobs, folder) as watch:
        return runner.run(jobs, folder, workers, watch=watch, engine=engine)


def stamped(values: Mapping[str, Any], seed: int, inputs: Iterable[Path]) -> Mapping[str, Any]:
    """Return the record with its provenance."""
    return {**values, "provenance": here(seed, {str(path): f"sha256:{policy_digest(path)}" for path in inputs})}


def folders(who: Iterable[Entrant]) -> list[Path]:
    """Return the folders or files of the policies that have one, unlike the scripted one and Python objects."""
    return [e.path for e in who if e.stored]


def check_numbers(episodes: int, workers: int) -> None:
    """Raise UserError for impossible numbers."""
    if episodes < 1:
        raise UserError("no episodes", key="--episodes", expected="1 or more", got=episodes)
    if workers < 1:
        raise UserError("no workers", key="--workers", expected="1 or more", got=workers)


def other_tolerances(who: Iterable[Entrant], worlds: Iterable[WorldFile]) -> list[str]:
    """Return a line on each policy that was made for another tolerance than a world's task has."""
    lines = []
    for file in worlds:
        config = config_of(file.task)
        if (about := config.tolerance) is not None:
            of_world, unit = getattr(config, about.setting), about.unit
            in_world = f"in {file.name} it is {of_world:g} {unit}"
            for e in who:
                if e.tolerance not in (None, of_world):
                    lines.append(f"{e.name} was made for {e.tolerance:g} {unit}, {in_world}")
    return list(dict.fromkeys(lines))


def check_controls(controls: str | Sequence[str] | None, world: WorldFile) -> tuple[str, ...]:
    """Return the requested controls: all that the world's cell has for None, and none for `none`.

    Raises:
        UserError: an unknown control.
    """
    choices = controls_of(scene_of(world.task))
    controls = None if controls is None else several(controls)
    if controls is not None and tuple(controls) == (NO_CONTROL,):
        return ()
    for control in controls or ():
        if control not in choices:
            raise UserError("unknown control", key="--controls", got=control, choices=(*choices, NO_CONTROL))
    return choices if controls is None else tuple(controls)
