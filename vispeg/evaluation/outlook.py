"""Estimate, before anything is built, how well a task will transfer: the article's table and signs with its numbers.

The success rates are the article's ("Sim-to-Real Transfer Success Rate by Task Type": published results and its
author's own data), not measurements of this project. The signs are its tips 6 and 15 and its section on skipping
simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

WELL, EFFORT, NOT = "transfers well", "transfers with effort", "does not transfer well"
SUBMILLIMETRE = 1.0  # mm: "sub-millimeter tolerances" do not transfer well yet
FEWEST_DEMONSTRATIONS, A_DAY = 1_000, 500  # skip simulation if fewer are needed in all, or a day gives as many or more
COARSE = "simulation for the approach, 50 to 200 real demonstrations for the contact (`combine`, `finetune`)"


@dataclass(frozen=True)
class Row:
    """A row of the article's table, rates of success in %.

    Attributes:
        task: the kind of task.
        simulated: rate in simulation.
        naive: range of the rate on a robot, without further techniques.
        techniques: range of the rate on a robot, with randomization and system identification.
    """

    task: str
    simulated: int
    naive: tuple[int, int]
    techniques: tuple[int, int]


INSERTION = Row("peg insertion (> 1 mm tolerance)", 90, (15, 25), (55, 70))
PRECISION = Row("precision assembly (< 0.5 mm)", 88, (5, 15), (30, 50))


class Sign(TypedDict):
    """One of the article's signs against simulation.

    Keys:
        sign: what it looks at.
        here: the number or answer for this task.
        speaks_from: the number or answer from which on it applies.
        speaks: whether it applies here.
        follows: what to do then.
    """

    sign: str
    here: str
    speaks_from: str
    speaks: bool
    follows: str


class Expected(TypedDict):
    """A row of the article's table that a task is near: rates in %, as in `Row`."""

    task: str
    simulated: int
    naive: list[int]
    techniques: list[int]


class Outlook(TypedDict):
    """The output of `vispeg plan --json`."""

    verdict: str
    why: str
    expected: list[Expected]
    signs: list[Sign]
    advice: list[str]


def outlook(
    tolerance_mm: float | None,
    repeatability_mm: float,
    *,
    soft: bool = False,
    varies: bool = False,
    demonstrations: int | None = None,
    a_day: int | None = None,
    build_days: float | None = None,
) -> Outlook:
    """Return what to expect of a task's transfer, and which of the article's signs apply.

    Args:
        tolerance_mm: width of the goal minus that of the part, mm; None for a task without a tolerance.
        repeatability_mm: pose repeatability of the robot (ISO 9283), mm.
        soft: whether a part deforms, flows or is granular.
        varies: whether success depends on a property that varies from object to object, such as surface friction.
        demonstrations: number that would teach the task on the robot alone; None if not known.
        a_day: number of demonstrations that can be recorded in a day; None if not known.
        build_days: days to build and calibrate the simulation; None if not known.
    """
    fine = tolerance_mm is not None and tolerance_mm < SUBMILLIMETRE
    coarse_arm = fine and repeatability_mm > SUBMILLIMETRE
    signs: list[Sign] = [
        _sign("a part deforms, flows or is granular", "yes" if soft else "no", "yes", soft, "skip simulation"),
        _sign("success hangs on what varies from object to object", "yes" if varies else "no", "yes", varies, COARSE),
    ]
    if tolerance_mm is not None:
        here = f"{tolerance_mm:g} mm, {repeatability_mm:g} mm"
        limit = "tolerance under 1 mm and repeatability over 1 mm"
        signs.append(_sign("precision against repeatability", here, limit, coarse_arm, COARSE))
        room = tolerance_mm / 2
        limit, too_wide = f"more than {room:g} mm a side", repeatability_mm > room
        signs.append(_sign("repeatability against the room on a side", here, limit, too_wide, COARSE))
    if demonstrations is not None:
        few = demonstrations < FEWEST_DEMONSTRATIONS
        signs.append(_sign("demonstrations needed", f"{demonstrations}", "under 1,000", few, "record on the robot"))
    if a_day is not None:
        signs.append(_sign("demonstrations a day", f"{a_day}", "500 or more", a_day >= A_DAY, "record on the robot"))
    if demonstrations is not None and a_day and build_days is not None:
        days = demonstrations / a_day
        here = f"{build_days:g} days to build, {days:.1f} to record"
        signs.append(_sign("effort", here, "building takes longer", build_days > days, "record on the robot"))
    if soft or varies or coarse_arm:
        verdict, why = NOT, "by the article's signs of a gap that cannot be bridged here"
    elif tolerance_mm is None:
        verdict, why = WELL, "a motion without tight contact, as reaching in free space or grasping"
    elif fine:
        verdict, why = (
            EFFORT,
            f"a tolerance of {tolerance_mm:g} mm is under a millimetre: the contact part does not transfer well",
        )
    else:
        verdict, why = EFFORT, "assembly of rigid parts with a generous tolerance"
    rows = [] if tolerance_mm is None or soft else [r for r in (INSERTION, PRECISION) if _near(r, tolerance_mm)]
    expected: list[Expected] = [
        {"task": r.task, "simulated": r.simulated, "naive": list(r.naive), "techniques": list(r.techniques)}
        for r in rows
    ]
    advice = list(dict.fromkeys(s["follows"] for s in signs if s["speaks"]))
    if fine and COARSE not in advice:
        advice.append(COARSE)
    return {"verdict": verdict, "why": why, "expected": expected, "signs": signs, "advice": advice}


def _sign(sign: str, here: str, speaks_from: str, speaks: bool, follows: str) -> Sign:
    return {"sign": sign, "here": here, "speaks_from": speaks_from, "speaks": speaks, "follows": follows}


def _near(row: Row, tolerance_mm: float) -> bool:
    """Return whether a row applies to a tolerance; between 0.5 and 1 mm both do."""
    return tolerance_mm >= 0.5 if row is INSERTION else tolerance_mm < SUBMILLIMETRE
