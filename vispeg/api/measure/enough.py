"""Test whether a measured interval is narrow enough for a policy: play it at both ends and compare its success."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

from vispeg.api.measure.result import MeasurementResult
from vispeg.api.playing import Playing, check_numbers, silent
from vispeg.core.files import write_text_atomic
from vispeg.evaluation import runner
from vispeg.evaluation.folder import workplace
from vispeg.evaluation.jobs import Setting, make_jobs, seeds_of
from vispeg.evaluation.overlay import Change
from vispeg.evaluation.players import ready
from vispeg.evaluation.statistics import decide, difference
from vispeg.evaluation.stress.interval import ends, verdict, words
from vispeg.evaluation.table import rows as outcomes
from vispeg.report.text.summary import Block, Line, Summarised
from vispeg.task.world_file import load_world
from vispeg.worlds.identified import acting
from vispeg.worlds.measurement_file import measurement_text


@dataclass(frozen=True)
class Sufficiency(Summarised):
    """The change of success over each effect's interval, for each policy.

    Attributes:
        rows: one per effect and policy: `effect`, `policy`, `episodes` at each end, change of success between the ends
            (`moved`) with its interval (`low`, `high`), `verdict`.
        result: the measurement, whose file includes these rows.
    """

    rows: Sequence[Mapping[str, Any]]
    result: MeasurementResult

    @property
    def summary(self) -> list[Block]:
        """One line per effect and policy."""
        if not self.rows:
            return [Line("no effect with an interval: nothing to play")]
        return [Line(_line(row), path=True) for row in self.rows]


def check_enough(policies: Sequence[str], world: str, episodes: int, workers: int) -> None:
    """Check the arguments of `enough` before anything is measured.

    Raises:
        UserError: unknown policies or world, or impossible numbers.
    """
    check_numbers(episodes, workers)
    load_world(world)
    if policies:
        ready(policies)


def enough(
    result: MeasurementResult,
    policies: Sequence[str],
    *,
    world: str = "nominal",
    episodes: int = 400,
    workers: int = 1,
    playing: Playing = silent,
) -> Sufficiency:
    """Play policies with each effect at the low and at the high end of its interval, on the same episodes.

    Args:
        result: a measurement, to whose file the rows are added.
        policies: policies (folders or names) to play at both ends of the interval, to see whether it is narrow enough.
        world: the world in which they are played, with the effect added at one end of its interval.
        episodes: number of episodes at each end of the interval.
        workers: number of processes.
        playing: shows progress.

    Raises:
        UserError: unknown policies or world, a measurement of another robot than the world's, or an effect that has no
            place in the world.
    """
    check_numbers(episodes, workers)
    found, file = result.measurement, load_world(world)
    placed = acting(found.effects, found.robot, file.world.base.robot, result.file)
    measured = [e for e in placed if ends(e)[0] != ends(e)[1]]
    if not measured:
        return Sufficiency((), result)
    who, name = ready(policies), file.name
    settings = [
        Setting(world, name, f"{e.label} {side}", (Change(e.effect, values, e.where),))
        for e in measured
        for side, values in zip(("low", "high"), ends(e), strict=True)
    ]
    rows: list[dict[str, object]] = []
    with workplace(None, "stop.json") as folder:
        jobs = make_jobs(who, settings, seeds_of(episodes), folder / "worlds")
        with playing(jobs, folder) as watch:
            played = runner.run(jobs, folder, workers, watch=watch)
    changes = {}
    for e, policy in product(measured, dict.fromkeys(x.policy for x in played)):
        own = [x for x in played if x.policy == policy]
        high, low = (outcomes(x for x in own if x.configuration == f"{e.label} {side}") for side in ("high", "low"))
        changes[e.label, policy] = difference(high, low, same_networks=True)
    decided = decide(changes)
    for (label, policy), decision in decided.items():
        moved = decision.estimate
        change = {"moved": float(moved.value), "low": float(moved.low), "high": float(moved.high)}
        judged = verdict(moved.low, moved.high, moved.n)
        rows.append({"effect": label, "policy": policy, "episodes": episodes, **change, "verdict": judged})
    details = {**result.measurement.details, "enough": {"world": name, "rows": rows}}
    full = replace(result.measurement, details=details)
    write_text_atomic(result.file, measurement_text(full), overwrite=True)
    return Sufficiency(rows, replace(result, measurement=full))


def _line(row: Mapping[str, Any]) -> str:
    return f"{row['effect']}, {row['policy']}: {words(row['moved'], row['low'], row['high'], row['verdict'])}"
