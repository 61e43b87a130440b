"""Plain types for the findings of a search: a candidate, its gain, a trial of it, its rivals, the verdict.

A candidate is an effect at a place, or a group of them added together. A trial is a fit with it, judged on held-out
recordings. Rivals of an accepted effect are other effects tried in its place; those that held-out data cannot tell from
it are its equals. A whitened residual is an error divided by its noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.identify.fit import Fit


@dataclass(frozen=True)
class Score:
    """One candidate with its gain.

    Attributes:
        placed: the effect with start values for a fit; of a group, its first member.
        gain: predicted drop of the squared whitened residual of the fitted recordings.
        beside: the other members of the group; empty for a single effect.
        out: accepted effects that this candidate would replace.
    """

    placed: EffectInstance
    gain: float
    beside: tuple[EffectInstance, ...] = ()
    out: tuple[EffectInstance, ...] = ()

    @property
    def members(self) -> tuple[EffectInstance, ...]:
        """All effects of the candidate."""
        return (self.placed, *self.beside)

    @property
    def count(self) -> int:
        """Number of members."""
        return 1 + len(self.beside)

    @property
    def key(self) -> tuple[str, str]:
        """(effect, where). Of a group: its effects joined by +, and the place that all share, `each` or `several`.

        `each` is a group of one kind of effect that every arm has in all joints (`Effect.common`), `several` any other.
        """
        names = dict.fromkeys(e.effect for e in self.members)
        if len({e.where for e in self.members}) == 1:
            return " + ".join(names), self.placed.where
        common = {effect(name).common for name in names}
        return " + ".join(names), "each" if len(common) == 1 and "" not in common and not self.out else "several"

    @property
    def label(self) -> str:
        """`coulomb_friction(joint4)`, or `coulomb_friction + viscous_friction(each)`."""
        return "{}({})".format(*self.key)

    def has(self, placed: EffectInstance) -> bool:
        """Return whether an effect at its place is one of the members."""
        return any((e.effect, e.where) == (placed.effect, placed.where) for e in self.members)


@dataclass(frozen=True)
class Gain:
    """Held-out improvement of one world over another.

    Attributes:
        mean: drop of the mean squared whitened residual.
        z: standard normal score of Wilcoxon's signed-rank test that blocks of time improve. A block is a short piece of
            a recording (`Judge`); neighbouring blocks with correlated errors count as one stretch
            (`Evidence.stretches`). A few blocks with large errors (reversals) do not drown the rest, as they would in a
            mean over its standard error.
        relative: `mean` over the mean squared whitened residual of the first world.
        joints: (nj,) relative drop in the columns of each joint.
    """

    mean: float
    z: float
    relative: float
    joints: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate after its fit.

    Attributes:
        score: the candidate.
        fit: on the fitted recordings; its world has the candidate.
        loss: (nblock, nj) held-out loss (`Judge.loss`).
        gain: held-out improvement over the world without the candidate.
        rejected: why it was rejected; empty if it passed.
        absent: whether null lies in the intervals of all its effects.
    """

    score: Score
    fit: Fit
    loss: np.ndarray
    gain: Gain
    rejected: str = ""
    absent: bool = False

    @property
    def bare(self) -> Trial:
        """Return the trial without the arrays of its fit, for the record."""
        return replace(self, fit=self.fit.bare)


@dataclass(frozen=True)
class Rivals:
    """Other effects in place of an accepted one: all that were `tried`, and those as good on held-out data (`equals`).

    `label` is the accepted effect's.
    """

    label: str
    equals: tuple[Trial, ...]
    tried: tuple[Trial, ...]


@dataclass(frozen=True)
class Verdict:
    """A verdict with its reason in one sentence, and the inputs that an unexplained residual depends on."""

    verdict: str
    reason: str
    unexplained: dict | None = None
    partial: bool = False  # the accepted effects are valid, but part of the error remains


def left_unexplained(text: str, on: Sequence[Mapping] = (), **more: Any) -> Verdict:
    """Return the verdict `unexplained` with its reason, the inputs that the remaining error depends on, and more."""
    return Verdict("unexplained", text, {"depends_on": list(on), "text": text, **more}, partial=True)


def made_ambiguous(verdict: Verdict, text: str) -> Verdict:
    """Return `identified` as `ambiguous` for the reason `text`, if there is one; other verdicts stay."""
    if verdict.verdict != "identified" or not text:
        return verdict
    return Verdict("ambiguous", text, partial=verdict.partial)
