"""perturb.json, sensitivity.json and exploit.json: where policies fail though they do well on average."""

from __future__ import annotations

from typing import NotRequired, TypedDict

from vispeg.evaluation.schema.estimate import Interval


class HardPosition(TypedDict):
    """A start of a list of positions: m and rad, against the nominal goal."""

    name: str
    x: NotRequired[float]
    y: NotRequired[float]
    height: NotRequired[float]
    roll: NotRequired[float]
    pitch: NotRequired[float]
    yaw: NotRequired[float]


class PushRow(TypedDict):
    """A policy at a position: success still and pushed, and what the push costs on the same seeds."""

    policy: str
    position: str
    still: Interval | None
    pushed: Interval | None
    cost: Interval | None
    p_holm: float | None
    verdict: str | None


class PushRecord(TypedDict):
    """perturb.json as `perturb.summarise` gives it."""

    format: str
    rows: list[PushRow]
    rule: str


class SweepPoint(TypedDict):
    """Success at one value; against the null value: what it costs, Holm's p, the verdict."""

    value: float
    success: Interval
    cost: NotRequired[Interval]
    p_holm: NotRequired[float | None]
    verdict: NotRequired[str]


class Curve(TypedDict):
    """A policy over the values of a sweep."""

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
    """Median peak force, N, on both sides, and the rank test's p."""

    fixed: float | None
    randomized: float | None
    p: float | None
    p_holm: float | None


class Count(TypedDict):
    """Successes of n episodes."""

    successes: int
    n: int


class ExploitRow(TypedDict):
    """A policy with fixed contact parameters and with randomized ones."""

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
    verdict: str
    words: str


class ExploitRecord(TypedDict):
    """exploit.json as `exploit.summarise` gives it."""

    format: str
    margin: float
    policies: list[ExploitRow]


class Priced(TypedDict):
    """A policy with the identified model and with what that leaves open; the cost on the same seeds."""

    policy: str
    modality: str
    identified: Interval
    left: Interval
    cost: Interval
    p: float | None
    p_holm: float | None
    verdict: str


class RemainderCost(TypedDict):
    """`cost` in diagnosis.json: the cell, episodes of each policy in each of the two, and a row a policy."""

    world: dict[str, str]
    episodes: int
    policies: list[Priced]
