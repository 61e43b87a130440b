"""Records of explain.json: why trials fail."""

from __future__ import annotations

from typing import Any, TypedDict

from vispeg.evaluation.outlook import Sign
from vispeg.evaluation.schema.estimate import Interval
from vispeg.evaluation.schema.gap import Measure, PartingRecord, Worth


class TrialRow(TypedDict):
    """One trial: how it ended, and how often replays from its start succeed.

    Attributes:
        trial: name of its folder.
        success, category: its outcome.
        closed: success of replays in which the policy acts.
        open: success of replays of the trial's recorded actions.
    """

    trial: str
    success: bool
    category: str
    closed: Interval
    open: Interval


class Rule(TypedDict):
    """One of the article's rules of thumb.

    Attributes:
        rule: what it looks at.
        value: the number here.
        limit: the number above which the rule applies.
        unit: unit of both.
        points_to: what is then to blame, such as `actuator`.
        speaks: whether it applies here.
    """

    rule: str
    value: float
    limit: float
    unit: str
    points_to: str
    speaks: bool


class Cause(TypedDict):
    """A named effect as a cause of failure.

    Attributes:
        effect: its label, or that of all effects together.
        params: its parameters' values.
        without, with_it: success from the trials' starts without and with it.
        cost: loss of success due to it.
        p_holm, verdict: the page's decision on the cost.
        share: its share of the whole loss; None where that cannot be told.
        points_to_it: the rules and senses that point to it.
        cure: what to do about it.
        hours: duration of the cure, h; None where it is not known.
        words: the cost in words.
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
    """One of a policy's senses, exchanged for simulation's.

    Attributes:
        sense: its name.
        moved_mm: mean distance by which the exchange moves the policy's action, mm.
        among_mm: the same between two draws of the simulated world, mm.
        more_mm: the difference of the two, mm.
        p_holm: the page's adjusted p-value of that difference.
        points_to: what the sense points to; "" for nothing.
        words: the distances in words.
    """

    sense: str
    moved_mm: float
    among_mm: float
    more_mm: Interval
    p_holm: float | None
    points_to: str
    words: str


class Moment(TypedDict):
    """The step at which exchanging a sense moves the action most.

    Attributes:
        number: index of the trial, from 0.
        trial: name of its folder.
        sense: the exchanged sense.
        step, time_s: the step, and its time since the trial's first step, s.
        robot_mm, simulated_mm: the offset that the policy asks for with the robot's and with simulation's sense, mm.
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
    """Share of the unexplained torque's power in a regime (free air or contact), and the number of its recordings."""

    share: float
    recordings: int


class RemainderRecord(TypedDict):
    """The torque that no named cause explains, and the policy's success without and with it.

    Attributes:
        recordings: names of the recordings that it comes from.
        block_s: length of the blocks in which it is resampled, s.
        joints: its size in each joint.
        regimes: its share in free air and in contact.
        without, with_it: success without and with it.
        cost: loss of success due to it.
        home: loss of success due to as much random torque in the policy's training world; None if not played.
        home_world: name of that world.
        matters: whether the cost is above 5 points; None where it cannot be told.
        words: the result in words.
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
    """One condition of the verdict that a gap cannot be bridged: its number here, and whether it is met.

    `met` is None where that is not known.
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
    """A next step.

    Attributes:
        step: what to do.
        gain: success that it can win back at most.
        hours: its duration, h; None where it is not known.
        hours_from: where that number comes from.
        an_hour: gain per hour; None without hours.
        command: the command that does it; "" for none.
    """

    step: str
    gain: Interval | None
    hours: float | None
    hours_from: str
    an_hour: float | None
    command: str


class Next(TypedDict):
    """What to do now: the reason and the command."""

    why: str
    command: str


class ExplainRecord(TypedDict):
    """explain.json without world and provenance; `left` is the loss of success that no cause explains."""

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
