"""`vispeg plan`: estimate the transfer to expect for a world's task on a real robot.

The article is the guide for practitioners that docs/sources.md names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.evaluation.bridging import tolerance_mm
from vispeg.evaluation.outlook import Outlook, outlook
from vispeg.report.text.summary import Block, Line, Summarised
from vispeg.report.text.tables import Column, Sheet
from vispeg.task.registry import config_of
from vispeg.task.world_file import load_world


@dataclass(frozen=True)
class Planned(Summarised):
    """The transfer to expect.

    Attributes:
        world: name of the world.
        outlook: verdict, the article's success rates for such tasks, its signs with their values here, and advice.
    """

    world: str
    outlook: Outlook

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg plan --json`."""
        return {"world": self.world, **self.outlook}

    @property
    def summary(self) -> list[Block]:
        """The verdict, the article's rates, its signs, and advice."""
        o = self.outlook
        out: list[Block] = [Line(f"{self.world}: {o['verdict']}: {o['why']}")]
        if o["expected"]:
            heads = [
                Column(h) for h in ("such tasks, by the article", "in simulation", "naive", "with randomization, sysid")
            ]
            rows = [
                [str(e["task"]), f"{e['simulated']} %", _range(e["naive"]), _range(e["techniques"])]
                for e in o["expected"]
            ]
            out.append(Sheet(heads, rows))
        heads = [Column(h) for h in ("sign", "here", "speaks from", "speaks")]
        out.append(
            Sheet(heads, [[s["sign"], s["here"], s["speaks_from"], "yes" if s["speaks"] else "-"] for s in o["signs"]])
        )
        return [*out, *(Line(f"advice: {text}") for text in o["advice"])]


def plan(
    world: str | Path = "nominal",
    *,
    repeatability: float | None = None,
    soft: bool = False,
    varies: bool = False,
    demonstrations: int | None = None,
    a_day: int | None = None,
    build_days: float | None = None,
) -> Planned:
    """Estimate the transfer to expect for a world's task on a real robot, by the article's table and signs.

    Args:
        world: a built-in world's name or a world file, whose task states the tolerance.
        repeatability: pose repeatability of the robot, mm (ISO 9283); default: from the world, or the arm's data sheet.
        soft: state that a part deforms, flows or is granular.
        varies: state that success depends on a property that varies between objects, such as surface friction.
        demonstrations: number of demonstrations that would teach the task without simulation.
        a_day: number of demonstrations that can be recorded in a day.
        build_days: days to build and calibrate the simulation.

    Raises:
        UserError: no such world, an impossible number, or an arm of unknown repeatability.
    """
    for key, number in (
        ("repeatability", repeatability),
        ("demonstrations", demonstrations),
        ("a-day", a_day),
        ("build-days", build_days),
    ):
        if number is not None and number <= 0:
            raise UserError("must be above 0", key=f"--{key}", got=number)
    file = load_world(world)
    config = config_of(file.task)
    known = config.robot.repeats_mm if repeatability is None else repeatability
    if known is None:
        raise UserError("not known of this arm", key="--repeatability", expected="mm, ISO 9283", got=config.robot.model)
    width = tolerance_mm(config)
    signs = {"soft": soft, "varies": varies, "demonstrations": demonstrations, "a_day": a_day, "build_days": build_days}
    return Planned(file.name, outlook(width, known, **signs))


def _range(ends: Sequence[int]) -> str:
    return f"{ends[0]} to {ends[1]} %"
