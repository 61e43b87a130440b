"""Records of perturb.json, sensitivity.json, exploit.json and of `cost` in diagnosis.json: where a policy fails.

In all of them:
    cost: success on one side minus success on the other, as shares, with its 95 % interval; both sides play the same
        seeds. The interval is that of the corrected test, so it excludes 0 where the verdict is `different`.
    p: p-value of the test that the cost is 0, see `vispeg.evaluation.statistics.difference`.
    p_holm: p, corrected by Holm's method for all tests of the record; None where no test could be made.
    verdict: `different`, `equal` (within the margin), or `these data cannot tell`.
    words: the verdict as a sentence, for reports.
"""

from __future__ import annotations

from typing import NotRequired, TypedDict

from vispeg.evaluation.schema.estimate import Interval


class HardPosition(TypedDict):
    """One entry of a list of hard positions.

    Attributes:
        x, y: offset of the goal from its nominal place, m.
        height: height from which the tip starts, right above the nominal goal, m; without it the task's own range.
        roll, pitch, yaw: rotation of the goal, rad.
    """

    name: str
    x: NotRequired[float]
    y: NotRequired[float]
    height: NotRequired[float]
    roll: NotRequired[float]
    pitch: NotRequired[float]
    yaw: NotRequired[float]


class PushRow(TypedDict):
    """Success of one policy at one position.

    Attributes:
        still, pushed: success without and with a push; None where that was not played.
        cost: `still` minus `pushed`; None, as p_holm and verdict, unless both were played.
    """

    policy: str
    position: str
    still: Interval | None
    pushed: Interval | None
    cost: Interval | None
    p_holm: float | None
    verdict: str | None


class PushRecord(TypedDict):
    """perturb.json, returned by `perturb.summarise`; `rule` is a sentence on how verdicts are made."""

    format: str
    rows: list[PushRow]
    rule: str


class SweepPoint(TypedDict):
    """Success at one value of a sweep.

    Attributes:
        value: in the sweep's unit.
        cost: success at the sweep's `null` minus success here. Of a measurement's interval only its high end has it.
    """

    value: float
    success: Interval
    cost: NotRequired[Interval]
    p_holm: NotRequired[float | None]
    verdict: NotRequired[str]


class Curve(TypedDict):
    """Success of one policy over the values of a sweep.

    Attributes:
        falls_at: of the values at which the verdict is that success is lower, the one nearest to the sweep's `null`;
            None for none.
        words: from where success is lower, or over which values it holds; of a measurement, whether it is good enough.
    """

    policy: str
    modality: str
    points: list[SweepPoint]
    falls_at: float | None
    words: str


class SweepRecord(TypedDict):
    """One of `sweeps` in sensitivity.json: parameters of one effect, set to each value in turn.

    Attributes:
        effect, params: the effect, and its parameters that have the value together.
        unit: unit of the values: the parameters' own, `times the value found` for an effect from a model, or
            `of the interval` from 0, its low end, to 1 for a measurement.
        null: the value with which the others are compared: there the effect vanishes, or the interval has its low end.
        label: the sweep's name for tables and axes, such as `focal_error@wrist_wide.fx,fy`.
    """

    format: str
    effect: str
    params: list[str]
    unit: str
    null: float
    label: str
    curves: list[Curve]


class Peak(TypedDict):
    """Peak force of one policy's episodes.

    Attributes:
        fixed, randomized: median with fixed and with randomized contact parameters, N; None without forces.
        p: p-value of the hypothesis that it is larger on one side as often as on the other, see
            `vispeg.evaluation.statistics.by_ranks`.
    """

    fixed: float | None
    randomized: float | None
    p: float | None
    p_holm: float | None


class Count(TypedDict):
    """Number of successes in n episodes."""

    successes: int
    n: int


class ExploitRow(TypedDict):
    """Success of one policy with fixed and with randomized contact parameters.

    Attributes:
        cost: `fixed` minus `randomized`.
        peak: peak force on both sides.
        substeps: setting of randomized episodes, `randomized, N substeps` -> their successes. N is the number of
            physics steps per control period.
        profiles: `fixed` and `randomized` -> course of the contact force, by policy step since the first contact:
            `low`, `median` and `high`, its quartiles over episodes, N, and `n`, the number of these.
        policy_period: time between two values of a profile, s; None without profiles.
        verdict: `exploits` (success is lower with randomized parameters), `gains` (it is higher), `does not exploit`
            (equal within the margin), or `these data cannot tell`.
    """

    policy: str
    modality: str
    fixed: Interval
    randomized: Interval
    cost: Interval
    p: float | None
    p_holm: float | None
    peak: Peak
    substeps: dict[str, Count]
    profiles: dict[str, dict[str, list[float]]]
    policy_period: NotRequired[float | None]
    verdict: str
    words: str


class ExploitRecord(TypedDict):
    """exploit.json, returned by `exploit.summarise`.

    Attributes:
        margin: difference of success, as a share, within which two rates are called equal.
    """

    format: str
    margin: float
    policies: list[ExploitRow]


class Priced(TypedDict):
    """Success of one policy in the identified model.

    Attributes:
        identified: success with every identified value as found.
        left: success with what the diagnosis left open: values drawn from their 95 % intervals, and the unexplained
            torque as noise.
        cost: `identified` minus `left`.
    """

    policy: str
    modality: str
    identified: Interval
    left: Interval
    cost: Interval
    p: float | None
    p_holm: float | None
    verdict: str


class RemainderCost(TypedDict):
    """`cost` in diagnosis.json: the cost of what a diagnosis left open.

    Attributes:
        world: `name` and `hash` of the world whose cell the policies play in.
        episodes: number of episodes of each policy, with and without what was left open.
        policies: one row per policy.
    """

    world: dict[str, str]
    episodes: int
    policies: list[Priced]
