"""explain.json: why trials fail."""

from __future__ import annotations

from typing import Any, TypedDict

from vispeg.evaluation.outlook import Sign
from vispeg.evaluation.schema.estimate import Interval
from vispeg.evaluation.schema.gap import Measure, PartingRecord, Worth


class TrialRow(TypedDict):
    """One trial: how it ended, and how often the policy and its recorded actions succeed from its start."""

    trial: str
    success: bool
    category: str
    closed: Interval
    open: Interval


class Rule(TypedDict):
    """One of the article's rules: what it looks at, the number here, the number from which it speaks, of what."""

    rule: str
    value: float
    limit: float
    unit: str
    points_to: str
    speaks: bool


class Cause(TypedDict):
    """A named effect: success from the trials' starts without and with it, its share of what is lost, what points to
    it, its cure, and the hours of that (None: not known).
    """

    effect: str
    params: dict[str, Any]
    without: Interval
    with_it: Interval
    cost: Interval
    p_holm: float | None
    verdict: str
    share: Interval | None
    points_to_it: list[str]
    cure: str
    hours: float | None
    words: str


class Sense(TypedDict):
    """One of a policy's senses: how far the action moves as simulation's is taken in its place, and what that shows.

    `among_mm` is the same between two draws of the world, `more_mm` how much farther the robot is.
    """

    sense: str
    moved_mm: float
    among_mm: float
    more_mm: Interval
    p_holm: float | None
    points_to: str
    words: str


class Moment(TypedDict):
    """Where a sense moves the action most: what the policy asks for (mm) by the robot's and by simulation's.

    `number` is the trial's, from 0, in the order of the trials.
    """

    number: int
    trial: str
    sense: str
    step: int
    time_s: float
    robot_mm: list[float]
    simulated_mm: list[float]


class RemainderSize(TypedDict):
    """RMS of the torque that no named cause explains, in one joint."""

    joint: str
    rms: float
    unit: str


class Regime(TypedDict):
    """Share of the unexplained torque's power in a regime, and recordings that have it."""

    share: float
    recordings: int


class RemainderRecord(TypedDict):
    """What no named cause explains, played back: its size, and the policy's success without and with it.

    `recordings` it is from, resampled in blocks of `block_s`; `regimes`: free air and contact. `home`: what as much
    random torque costs where the policy was trained; None where that was not played.
    """

    recordings: list[str]
    block_s: float
    joints: list[RemainderSize]
    regimes: dict[str, Regime]
    without: Interval
    with_it: Interval
    cost: Interval
    home: Interval | None
    home_world: str
    matters: bool | None
    words: str


class Condition(TypedDict):
    """One condition of the verdict that a gap cannot be bridged: its number here, and whether it is met (None: not
    known).
    """

    condition: str
    here: str
    met: bool | None


class Bridge(TypedDict):
    """The verdict on whether the gap can be bridged here: its words, its conditions, and the article's signs."""

    verdict: str
    words: str
    conditions: list[Condition]
    signs: list[Sign]


class Step(TypedDict):
    """A next step: what it can gain at most, in success, its hours and where they are from, the gain an hour, and the
    command.
    """

    step: str
    gain: Interval | None
    hours: float | None
    hours_from: str
    an_hour: float | None
    command: str


class Next(TypedDict):
    """What to do now: why, and the command."""

    why: str
    command: str


class ExplainRecord(TypedDict):
    """explain.json without world and provenance; `left`: what is lost of which no cause says why."""

    format: str
    policy: str
    verdict: str
    words: str
    robot: Interval
    closed: Interval
    open: Interval
    gap: Interval
    failed: Interval | None
    trials: list[TrialRow]
    categories: PartingRecord
    measures: list[Measure]
    rules: list[Rule]
    causes: list[Cause]
    senses: list[Sense]
    moment: Moment | None
    worth: Worth
    left: Interval
    remainder: RemainderRecord | None
    bridge: Bridge
    steps: list[Step]
    next: Next | None
    notes: list[str]
    rule: str
