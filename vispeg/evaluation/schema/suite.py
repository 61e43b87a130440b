"""Records of suite.json and compare.json: configurations in two worlds, over versions of a policy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NotRequired, TypedDict

from vispeg.evaluation.schema.estimate import Interval, WorldHash


class Changed(TypedDict):
    """An effect in a configuration; it replaces the world's own."""

    effect: str
    where: NotRequired[str]
    params: NotRequired[Mapping[str, object]]


class Configuration(TypedDict):
    """An entry of a suite: `task` replaces settings of the world's task, `effects` replaces effects of the world."""

    name: str
    about: NotRequired[str]
    task: NotRequired[Mapping[str, object] | None]
    effects: NotRequired[Sequence[Changed] | None]


class SuiteRow(TypedDict):
    """Success of a policy in a configuration, in the training world and in the target."""

    configuration: str
    policy: str
    train: Interval
    target: Interval


class Fall(TypedDict):
    """Loss of success of a policy from the training world to the target, its mean over configurations.

    `beyond_doubt` tells whether the whole interval lies above 5 points.
    """

    policy: str
    fall: Interval
    beyond_doubt: bool


class Measures(TypedDict, total=False):
    """Correlation of success in the two worlds over configurations, and mean loss; absent if there are too few."""

    pearson: Interval
    mean_difference: Interval


class Health(Measures):
    """The verdict on a version, `status`: `healthy`, `watch`, `alarm` or `these data cannot tell`."""

    n: int
    status: str
    words: str


class SuiteRecord(TypedDict):
    """suite.json."""

    format: str
    version: str
    train: str
    target: str
    rows: list[SuiteRow]
    health: Health
    worlds: NotRequired[list[WorldHash] | None]
    falls: NotRequired[list[Fall]]
    notes: NotRequired[list[str] | None]
    provenance: NotRequired[Mapping[str, object] | None]


class VersionChange(TypedDict):
    """Change of success of a policy in a configuration, new version minus old."""

    policy: str
    world: str
    configuration: str
    change: Interval
    p_holm: float | None
    verdict: str
