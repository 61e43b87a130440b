"""Arguments that every measurement has, and how its result is printed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vispeg.cli.output import Output, OutputOptions
from vispeg.core.errors import UserError

if TYPE_CHECKING:
    from vispeg.api.measure.result import MeasurementResult, MeasureSettings


@dataclass(frozen=True)
class Stop:
    """Whether it is enough."""

    policy: tuple[str, ...] = ()
    """Policies (folders or names) to play at both ends of the interval, to see if it is narrow enough."""
    world: str = "nominal"
    """World of the policies, and source of nominal values."""
    episodes: int = 400
    """Episodes at each end of the interval."""
    workers: int = 1
    """Processes."""


@dataclass(frozen=True, kw_only=True)
class Measuring:
    """What every measurement takes."""

    out: Path
    """The measurement file to write (.yaml)."""
    conditions: tuple[str, ...] = ()
    """Conditions to note in the file, such as surface=steel temperature=21."""
    seed: int = 0
    """Seed of the Monte Carlo propagation."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    enough: Annotated[Stop, tyro.conf.arg(name="")] = Stop()
    output: OutputOptions = Output()

    def settings(self, resolution: tuple[str, ...] = (), accuracy: tuple[str, ...] = ()) -> MeasureSettings:
        """For the functions of `vispeg.api.measure`. Raises UserError before anything is read."""
        from vispeg.api.measure.enough import check_stop
        from vispeg.api.measure.result import MeasureSettings

        check_stop(self.enough.policy, self.enough.world, self.enough.episodes, self.enough.workers)
        return MeasureSettings(resolution, accuracy, stated(self.conditions), self.seed, self.overwrite)

    def tell(self, result: MeasurementResult) -> int:
        """Print the measurement; then, where policies are named, play them and say whether it is enough."""
        from vispeg.api.measure.enough import enough
        from vispeg.cli.progress import playing
        from vispeg.report.text.summary import print_summary

        if not self.output.json:
            print_summary(result.summary)
        if self.enough.policy:
            judged = enough(
                result,
                self.enough.policy,
                world=self.enough.world,
                episodes=self.enough.episodes,
                workers=self.enough.workers,
                playing=lambda jobs, folder: playing(jobs, folder, self.output.quiet),
            )
            result = judged.result
            if not self.output.json:
                print_summary(judged.summary)
        if self.output.json:
            self.output.give(result.record, [])
        return 0


def stated(texts: Iterable[str], key: str = "--conditions", expected: str = "NAME=TEXT") -> dict[str, str]:
    """`NAME=TEXT` pairs. Raises UserError for others, and for a name given twice."""
    out = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name or name in out:
            raise UserError("given twice" if name in out else "not a pair", key=key, expected=expected, got=text)
        out[name] = value
    return out
