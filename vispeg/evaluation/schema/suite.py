"""suite.json and compare.json: configurations in two worlds, over versions of a policy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NotRequired, TypedDict

from vispeg.evaluation.schema.estimate import Interval, WorldHash


class Changed(TypedDict):
    """An effect of a configuration, in place of the world's own."""

    effect: str
    where: NotRequired[str]
    params: NotRequired[Mapping[str, object]]


class Configuration(TypedDict):
    """An entry of a suite: `task` replaces keys of the world's task, `effects` its effects."""

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
    """Loss of a policy from the training world to the target, over configurations."""

    policy: str
    fall: Interval
    beyond_doubt: bool


class Measures(TypedDict, total=False):
    """How success in one world goes with success in the other; absent of too few configurations."""

    pearson: Interval
    mean_difference: Interval


class Health(Measures):
    """The verdict on a version: healthy, watch, alarm or cannot tell."""

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
    """A configuration of a policy in two versions, new minus old."""

    policy: str
    world: str
    configuration: str
    change: Interval
    p_holm: float | None
    verdict: str
