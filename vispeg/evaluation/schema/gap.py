"""gap.json: policies in worlds, what is lost, and to what."""

from __future__ import annotations

from typing import TypedDict

from vispeg.evaluation.schema.estimate import Interval, WorldHash


class PolicyRow(TypedDict):
    """A policy that takes part; `home`: the worlds it was trained in, None where nothing tells."""

    name: str
    modality: str
    train_seeds: list[int]
    blind: bool
    scripted: bool
    home: list[str] | None


class SuccessRow(TypedDict):
    """A policy in a world under a control ("": none): success, outcomes, mean time (s) and peak force (N)."""

    policy: str
    modality: str
    world: str
    control: str
    success: Interval
    words: str
    needed: int | None
    categories: dict[str, int]
    time: float | None
    peak_force: float | None


class Worth(TypedDict):
    """Value of a simulator in real trials: correlation of paired outcomes, and how many further trials it is worth."""

    rho: Interval
    trials: Interval
    buys: bool | None
    words: str


class GapRow(TypedDict):
    """Loss of a policy from the reference world to another, over its networks (by training seed); `home`: trained in
    that other world, so not a transfer. `worth`: for a robot whose trials are paired with episodes, else None.
    """

    policy: str
    modality: str
    world: str
    home: bool
    paired: bool
    train_seeds: list[int]
    gap: Interval
    p: float | None
    p_holm: float | None
    verdict: str
    words: str
    worth: Worth | None


class AttributionRow(TypedDict):
    """A policy's total gap, split into factors and their interaction; a factor's share of it with Fieller's interval,
    None where the total may be 0.
    """

    policy: str
    modality: str
    parts: dict[str, Interval]
    verdict: dict[str, str]
    share: dict[str, Interval | None]


class ComparisonRow(TypedDict):
    """Two policies in one world: success of `first` minus that of `second`; `refused`: why no test is made, or ""."""

    world: str
    first: str
    second: str
    paired: bool
    difference: Interval
    p: float | None
    p_holm: float | None
    verdict: str
    refused: str
    needed: int | None


class Point(TypedDict):
    """Mean success of one network in the reference world and in the target."""

    policy: str
    train_seed: int
    reference: float
    target: float


class PredictionRow(TypedDict):
    """How well success in the reference world tells success in the target, over policies: the correlation of their true
    rates, that of the measured ones and its ceiling by the number of episodes (None where it has none), the mean
    maximum rank violation among the `ordered` pairs whose order is beyond doubt in both worlds, and the mean loss.
    """

    world: str
    n: int
    pearson: Interval
    measured: float | None
    ceiling: float | None
    mmrv: float
    ordered: int
    mean_difference: Interval
    words: str
    points: list[Point]


class KindRow(TypedDict):
    """How often one category of failure happened on two sides."""

    category: str
    first: float
    second: float
    p: float | None
    p_holm: float
    verdict: str


class PartingRecord(TypedDict):
    """Failures by category on two sides: see `vispeg.evaluation.categories.Parting`."""

    first: dict[str, int]
    second: dict[str, int]
    p: float | None
    where: str
    residual: float
    verdict: str
    kinds: list[KindRow]
    words: str


class PartingRow(PartingRecord):
    """The same of a policy in the reference world and in another, with the episodes on each side."""

    policy: str
    world: str
    n: list[int]


class Measure(TypedDict):
    """Medians of time or peak force in the simulation and on the robot, with the rank test's p."""

    measure: str
    unit: str
    first: float
    second: float
    n: list[int]
    p: float | None
    verdict: str
    apart: bool
    words: str


class MeasureRow(Measure):
    """The same of a policy."""

    policy: str
    world: str


class GapRecord(TypedDict):
    """The record."""

    format: str
    reference: str
    worlds: list[WorldHash]
    joint: str | None
    factors: list[str]
    policies: list[PolicyRow]
    success: list[SuccessRow]
    gaps: list[GapRow]
    attribution: list[AttributionRow]
    comparisons: list[ComparisonRow]
    prediction: list[PredictionRow]
    categories: list[PartingRow]
    measures: list[MeasureRow]
    notes: list[str]
    rule: str


class Side(TypedDict):
    """One film: names of its files relative to the folder of the record."""

    world: str
    outcome: str
    video: str | None
    image: str | None
    view: str | None


class Film(TypedDict):
    """A seed of a policy, filmed in one world or in several."""

    policy: str
    seed: int
    sides: list[Side]
