"""Whether an interval is narrow enough for a policy: how far success moves between its two ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

if TYPE_CHECKING:
    from vispeg.core.effect import EffectInstance
    from vispeg.worlds.measurement_file import Measurement

POINT = 0.01  # of success: below it a measurement is good enough


@dataclass(frozen=True)
class Stop:
    """Whether it is enough."""

    policy: tuple[str, ...] = ()
    """Policies (folders or names) to play at both ends of the interval: says whether it is narrow enough for them."""
    world: str = "nominal"
    """The world in which they are played, and from which nominal values are read."""
    episodes: int = 400
    """Episodes at each end of the interval."""
    workers: int = 1
    """Processes that play."""


Asked = Annotated[Stop, tyro.conf.arg(name="")]


def enough(measurement: Measurement, out: Path, stop: Stop, quiet: bool) -> tuple[Measurement, list[str]]:
    """Plays the policies with each effect at the low and at the high end of its intervals, on the same episodes.

    Returns:
        (the measurement with the result in its details, as `out` now has it; a line an effect and policy).

    Raises:
        UserError: unknown policies or world; an effect that has no place in the world.
    """
    from vispeg.cli.progress import playing
    from vispeg.core.files import write_text_atomic
    from vispeg.evaluation import runner
    from vispeg.evaluation.folder import workplace
    from vispeg.evaluation.jobs import Setting, make_jobs, seeds_of
    from vispeg.evaluation.overlay import Change
    from vispeg.evaluation.players import ready
    from vispeg.evaluation.statistics.crossed import difference
    from vispeg.evaluation.table import Table
    from vispeg.task.world_file import load_world
    from vispeg.worlds.measurement_file import measurement_text

    measured = [e for e in measurement.effects if ends(e)[0] != ends(e)[1]]
    if not measured:
        return measurement, ["no effect with an interval: nothing to play"]
    who, name, episodes = ready(stop.policy), load_world(stop.world).name, stop.episodes
    settings = [
        Setting(stop.world, name, f"{e.label} {side}", (Change(e.effect, values, e.where),))
        for e in measured
        for side, values in zip(("low", "high"), ends(e), strict=True)
    ]
    rows: list[dict[str, Any]] = []
    with workplace(None, "stop.json") as folder:
        jobs = make_jobs(who, settings, seeds_of(episodes), folder / "worlds")
        with playing(jobs, folder, quiet) as watch:
            played = runner.run(jobs, folder, stop.workers, watch=watch)
        table = Table([replace(e, world=e.configuration, configuration="") for e in played])
        for e in measured:
            for policy in dict.fromkeys(episode.policy for episode in played):
                y = table.aligned(policy, [f"{e.label} low", f"{e.label} high"])
                moved = difference(y[f"{e.label} high"], y[f"{e.label} low"], same_networks=True)
                rows.append({"effect": e.label, "policy": policy, "episodes": episodes} | _row(moved))
    lines = []
    for row in rows:
        low, high = (100 * row[key] for key in ("low", "high"))
        moves = f"{100 * row['moved']:+.1f} points [{low:+.1f}, {high:+.1f}]"
        lines.append(f"{row['effect']}, {row['policy']}: over the interval success moves by {moves}: {row['verdict']}")
    full = replace(measurement, details={**measurement.details, "enough": {"world": name, "rows": rows}})
    write_text_atomic(out, measurement_text(full), overwrite=True)
    return full, lines


def ends(placed: EffectInstance) -> tuple[dict[str, float], dict[str, float]]:
    """All values of an effect with those that have an interval at its low and at its high end."""
    low = {k: v.value if v.low is None else v.low for k, v in placed.params.items()}
    return low, {k: v.value if v.high is None else v.high for k, v in placed.params.items()}


def verdict(low: float, high: float, episodes: int) -> str:
    """What the 95 % interval of the change of success says.

    Args:
        low, high: of success at one end of the measurement's interval less at the other, shares.
        episodes: played.
    """
    if max(abs(low), abs(high)) < POINT:
        return "enough, stop measuring"
    if low > POINT or high < -POINT:
        return "measure on"
    return f"{episodes} episodes cannot tell whether it is under a point"


def _row(moved: Any) -> dict[str, Any]:
    ends = {"moved": float(moved.value), "low": float(moved.low), "high": float(moved.high)}
    return ends | {"verdict": verdict(moved.low, moved.high, moved.n)}
