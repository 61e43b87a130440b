"""Plain types for the findings of a search: a candidate, its gain, a trial of it, its competitors, the verdict."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.identify.fit import Fit


@dataclass(frozen=True)
class Score:
    """One candidate.

    Attributes:
        placed: the effect with start values for a fit.
        gain: drop of the squared whitened residual, to first order.
        beside: the other members of a group that is added together.
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
        """(effect, where). Of a group: its effects, with `each`, or `several` if the places were chosen by the data."""
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
        z: standard normal score of Wilcoxon's signed-rank test over blocks of time, or over stretches of them in which
            errors last (`Evidence.stretches`); its few heavy blocks (reversals) do not drown the rest, as they would in
            a mean over its standard error.
        relative: drop over what there was.
        joints: (nj,) the same in the channels of each joint.
    """

    mean: float
    z: float
    relative: float
    joints: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, eq=False)
class Trial:
    """A fitted candidate: its world, held-out result and reason of refusal, and whether its effects may be absent."""

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
    """Competitors of one accepted effect that held-out data cannot distinguish from it, and all that were tried."""

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
