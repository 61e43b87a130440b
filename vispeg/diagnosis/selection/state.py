"""State of a search: the present world with its losses and fit, and the steps that led to it.

A loss (nblock, nj) is a sum of squared whitened residuals (errors over noise) by block of time and joint (`Judge`).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.findings import Rivals, Score, Trial
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.worlds.world import World


@dataclass
class State:
    """State of a search.

    Attributes:
        world: the present model; at the start the user's.
        loss: its held-out loss.
        residual: (n,) its whitened residual on the fitted recordings.
        n_fixed: number of its first effects, which are not fitted and stay.
        fit: of its added effects; None if nothing is fitted yet.
        first: held-out mean squared whitened residual at the start.
        steps: for each step the trial that was accepted, and all trials.
        last: trials of the last step, if it accepted none.
        screening: scores of the last screening.
        opened: the user's model with its partial effects fitted anew; None if it has none.
        cross: cross-fitted loss on the fitted recordings (`Cross`).
        slight: labels of effects that lower the held-out error, but by no visible share (`prune`).
        within_noise: whether the first error is no larger than what noise in the feedback makes
            (`noise_motion.within_noise`); then nothing is added.
        rivals: of the accepted effects, when a replacement was last tried.
        replaced: labels of effects that a better rival has replaced; they do not come back.
        widened: for each fitted item the factors by which its noise is widened (`weigh`); none if nothing is weighed.
        concluded: whether the search made its last revision (`ContactSearch`), so that no move follows.
    """

    world: World
    loss: np.ndarray
    residual: np.ndarray
    n_fixed: int
    fit: Fit | None = None
    first: float = 0.0
    steps: list[tuple[Trial, list[Trial]]] = field(default_factory=list)
    last: list[Trial] = field(default_factory=list)
    screening: list[Score] = field(default_factory=list)
    opened: World | None = None
    cross: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    slight: frozenset[str] = frozenset()
    within_noise: bool = False
    rivals: Sequence[Rivals] = ()
    replaced: frozenset[str] = frozenset()
    widened: Sequence[np.ndarray | float] = ()
    concluded: bool = False

    @property
    def added(self) -> tuple[EffectInstance, ...]:
        """The effects that are fitted: all after the first `n_fixed`."""
        return self.world.effects[self.n_fixed :]

    def take(self, fit: Fit, loss: np.ndarray) -> None:
        """Update the state to a fit with its held-out loss."""
        self.world, self.fit, self.loss, self.residual = fit.world, fit, loss, fit.residual

    def weigh(self, evidence: Evidence) -> None:
        """Weigh the fitted recordings by the errors that the present world leaves in them (`Evidence.weigh`)."""
        factor = evidence.weigh(self.residual)
        self.widened = [item.widened for item in evidence.items]
        self.residual = self.residual * factor
        if self.fit is not None:
            columns = tuple(c * factor[:, None] for c in self.fit.columns)
            self.fit = replace(self.fit, residual=self.residual, columns=columns, cost=evidence.chi2(self.residual))

    def derivatives(self, out: Sequence[EffectInstance] = ()) -> np.ndarray | None:
        """Return the derivatives (n, k) of the fit to its coordinates, without those of the effects `out`.

        None if nothing is fitted.
        """
        if self.fit is None:
            return None
        if not out:
            return self.fit.jacobian
        gone = {e.label for e in out}
        stay = [self.world.effects[a.index].label not in gone for a in self.fit.space.axes]
        return self.fit.jacobian[:, stay]

    def step_that_added(self, placed: EffectInstance, grouped: bool = False) -> tuple[Trial, list[Trial]] | None:
        """Return the step whose other candidates were tried in place of an effect: the last one that added it.

        None if that step added it in place of another, or with others (unless `grouped`: the others are gone), or if
        the effects beside the step's have changed since. Steps without other candidates are skipped.
        """
        beside = {e.label for e in self.world.effects} - {placed.label}
        for best, trials in self.steps[::-1]:
            if best.score.has(placed) and len(trials) > 1:
                alone = (grouped or best.score.count == 1) and not best.score.out
                added = {e.label for e in best.score.members}
                same = {e.label for e in best.fit.world.effects} - added == beside
                return (best, trials) if alone and same else None
        return None

    def grouped(self, placed: EffectInstance) -> bool:
        """Return whether an effect was added as one of a group, without a test of its own."""
        came = [best.score for best, _ in self.steps if best.score.has(placed)]
        return bool(came) and bool(came[-1].beside)

    @property
    def scale(self) -> float:
        """What an accepted effect typically removed of the held-out mean squared residual (geometric mean over steps).

        Before any was accepted, it is all of the excess over noise. Small later drops may be errors of the accepted
        effects' form, which are proportional to what these removed. With the geometric mean they are not compared with
        one dominant effect alone.
        """
        removed = [share for share in self._shares()[0] if share > 0]
        return float(stats.gmean(removed)) if removed else max(self.first - 1.0, 1e-9)

    def removed_by(self, placed: EffectInstance) -> float:
        """Return how much of the held-out mean squared residual an effect removed.

        It is an equal share of what the step that added it removed and of what the effects that it replaced had
        removed; for an effect of the user's model, all of the excess over noise at the start.
        """
        return self._shares()[1][placed.label]

    def _shares(self) -> tuple[list[float], dict[str, float]]:
        """Return what each effect of a step removed (`removed_by`): by step, and the last one by the effect's label."""
        by_step: list[float] = []
        by_label: dict[str, float] = defaultdict(lambda: max(self.first - 1.0, 1e-9))
        for best, _ in self.steps:
            replaced = sum(by_label[e.label] for e in best.score.out)
            by_step.append((best.gain.mean + replaced) / best.score.count)
            by_label |= dict.fromkeys((e.label for e in best.score.members), by_step[-1])
        return by_step, by_label


def without(world: World, effects: Sequence[EffectInstance]) -> World:
    """Return the world without some of its effects."""
    for e in effects:
        world = world.without(e.effect, e.where)
    return world
