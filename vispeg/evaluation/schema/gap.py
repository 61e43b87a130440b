"""Records of gap.json: policies in worlds, their losses of success, and the factors of these."""

from __future__ import annotations

from typing import TypedDict

from vispeg.evaluation.schema.estimate import Interval, WorldHash


class PolicyRow(TypedDict):
    """A policy that takes part; `home` lists the worlds that it was trained in, None where they are not known."""

    name: str
    modality: str
    train_seeds: list[int]
    blind: bool
    scripted: bool
    home: list[str] | None


class SuccessRow(TypedDict):
    """A policy in a world under a control ("" for none): success, outcomes, mean time (s) and mean peak force (N).

    The time is that of successes. `needed` is the number of episodes that would tell the rate to 5 points; None where
    these are enough, or with several networks.
    """

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
    """Value of a simulator in real trials, see `vispeg.evaluation.statistics.Worth`."""

    rho: Interval
    trials: Interval
    buys: bool | None
    words: str


class GapRow(TypedDict):
    """Loss of success of a policy from the reference world to another.

    Attributes:
        home: whether it was trained in that other world, so that this is no transfer.
        paired: whether both sides played the same episodes.
        train_seeds: training seeds of the networks that played both sides.
        gap: success in the reference minus success in the other world.
        worth: value of simulation for a robot whose trials pair with episodes, else None.
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
    """A policy's total gap, its parts by factor, and their interaction.

    Attributes:
        parts: `total`, each factor, and `remainder` (the interaction) -> loss of success.
        verdict: the same names -> verdict.
        share: factor -> its share of the total, with Fieller's interval; None where the total may be 0.
    """

    policy: str
    modality: str
    parts: dict[str, Interval]
    verdict: dict[str, str]
    share: dict[str, Interval | None]


class ComparisonRow(TypedDict):
    """Two policies in one world: success of `first` minus that of `second`.

    `refused` tells why no test is made, "" if one is. `needed` is the number of pairs that would decide; None where
    these are enough, or where episodes do not pair.
    """

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
    """How well success in the reference world predicts success in another world, over policies.

    Attributes:
        n: number of policies.
        pearson: correlation of their true rates.
        measured: correlation of their measured rates; None where it is not defined.
        ceiling: largest value of `measured` to be expected with so many episodes; None where it is not defined.
        mmrv: mean maximum rank violation, over pairs whose order is decided in both worlds.
        ordered: number of these pairs.
        mean_difference: mean loss of success.
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
    """A PartingRecord for a policy in the reference world and in another, with the number of episodes on each side."""

    policy: str
    world: str
    n: list[int]


class Measure(TypedDict):
    """Medians of time or peak force in simulation and on the robot, with the p-value of the rank test.

    `apart` marks a peak force that was found to differ, and by more than half.
    """

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
    """A Measure of one policy in one world."""

    policy: str
    world: str


class GapRecord(TypedDict):
    """gap.json, see `vispeg.evaluation.gap.gap`."""

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
    """One film: its world, its outcome, and the paths of its files relative to the folder of the record."""

    world: str
    outcome: str
    video: str | None
    image: str | None
    view: str | None


class Film(TypedDict):
    """A seed of one network of a policy, filmed in one world or in several."""

    policy: str
    train_seed: int
    seed: int
    sides: list[Side]
