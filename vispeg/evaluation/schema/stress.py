"""Records of perturb.json, sensitivity.json, exploit.json and price.json: conditions in which a policy fails.

`p_holm` is a p-value corrected by Holm's method for the number of comparisons.
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
    """A policy at one position: success without and with a push, and the loss to the push on the same seeds."""

    policy: str
    position: str
    still: Interval | None
    pushed: Interval | None
    cost: Interval | None
    p_holm: float | None
    verdict: str | None


class PushRecord(TypedDict):
    """perturb.json, returned by `perturb.summarise`; `rule` states how verdicts are made."""

    format: str
    rows: list[PushRow]
    rule: str


class SweepPoint(TypedDict):
    """Success at one value of the effect; for values other than null, the loss against null, Holm's p and verdict."""

    value: float
    success: Interval
    cost: NotRequired[Interval]
    p_holm: NotRequired[float | None]
    verdict: NotRequired[str]


class Curve(TypedDict):
    """Success of one policy over the values of a sweep.

    `falls_at` is the value nearest to null at which success is found to be lower; None for none.
    """

    policy: str
    modality: str
    points: list[SweepPoint]
    falls_at: float | None
    words: str


class SweepRecord(TypedDict):
    """One of `sweeps` in sensitivity.json."""

    format: str
    effect: str
    params: list[str]
    unit: str
    null: float
    label: str
    curves: list[Curve]


class Peak(TypedDict):
    """Median over episodes of the peak force, N, with fixed and with randomized contact parameters; rank test."""

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

    `policy_period` is the time between two values of a profile, s; None without profiles.
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
    """exploit.json, returned by `exploit.summarise`."""

    format: str
    margin: float
    policies: list[ExploitRow]


class Priced(TypedDict):
    """Success of one policy in the identified model, and with the unexplained residual; loss on the same seeds."""

    policy: str
    modality: str
    identified: Interval
    left: Interval
    cost: Interval
    p: float | None
    p_holm: float | None
    verdict: str


class RemainderCost(TypedDict):
    """`cost` in diagnosis.json: the cell, episodes per policy and model, and one row per policy."""

    world: dict[str, str]
    episodes: int
    policies: list[Priced]
