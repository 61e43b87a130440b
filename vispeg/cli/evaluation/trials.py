"""What commands that play episodes share: which ones, in how many processes, and the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Protocol, TypedDict

import tyro

from vispeg.cli.output import Output, OutputOptions

if TYPE_CHECKING:
    from vispeg.api.playing import Playing
    from vispeg.core.cluster import Engine
    from vispeg.report.text.summary import Block


class Options(TypedDict):
    """What the functions that play episodes take beside what they play."""

    seed: int
    workers: int
    engine: Engine
    out: Path
    overwrite: bool
    playing: Playing


class Shown(Protocol):
    """A result of theirs."""

    @property
    def record(self) -> Mapping[str, object]: ...  # noqa: D102
    @property
    def summary(self) -> Sequence[Block]: ...  # noqa: D102


@dataclass(frozen=True)
class Trials:
    """Trials."""

    seed: int = 0
    """Seed of the episodes. The same seed gives the same starts and draws of the world."""
    workers: int = 1
    """Processes."""
    engine: Literal["local", "ray"] = "local"
    """Where they are: on this machine, or on a Ray cluster (the one at RAY_ADDRESS, if set)."""
    overwrite: bool = False
    """Replace the result in OUT."""
    output: OutputOptions = Output()

    def options(self, out: Path) -> Options:
        """Of a function that plays episodes into this folder, with a bar for each policy."""
        from vispeg.cli.progress import playing

        return {
            "seed": self.seed,
            "workers": self.workers,
            "engine": self.engine,
            "out": out,
            "overwrite": self.overwrite,
            "playing": lambda jobs, folder: playing(jobs, folder, self.output.quiet),
        }

    def give(self, result: Shown, page: Path, *others: str) -> None:
        """Print a result, where its page lies, and what else was written."""
        from vispeg.report.text.summary import Line

        lines = [Line(text, path=True) for text in (str(page), *others)]
        self.output.give(result.record, [*result.summary, *lines])


Played = Annotated[Trials, tyro.conf.arg(name="")]
