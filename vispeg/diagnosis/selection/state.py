"""State of a search and its trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.evidence.localise import MissingTorque
from vispeg.diagnosis.findings import Score, Trial
from vispeg.identify.fit import Fit
from vispeg.worlds.world import World


@dataclass
class State:
    """State of a search; `world` starts as the user's model."""

    world: World
    loss: np.ndarray
    residual: np.ndarray
    fit: Fit | None = None
    first: float = 0.0  # held-out mean squared residual at the start
    steps: list[tuple[Trial, list[Trial]]] = field(default_factory=list)
    last: list[Trial] = field(default_factory=list)  # candidates of a step that accepted none
    screening: list[Score] = field(default_factory=list)
    missing: list[MissingTorque] = field(default_factory=list)
    opened: World | None = None  # the user's model with its partial effects fitted anew
    cross: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))  # cross-fitted loss on the fitted recordings
    cast_out: set[tuple[str, ...]] = field(default_factory=set)  # labels of worlds, and of effects removed in trials
    slight: frozenset[str] = frozenset()  # labels of effects that only held-out data need

    def take(self, fit: Fit, loss: np.ndarray) -> None:
        """Update the state to a fit with its held-out loss."""
        self.world, self.fit, self.loss, self.residual = fit.world, fit, loss, fit.residual

    def derivatives(self, out: Sequence[EffectInstance] = ()) -> np.ndarray | None:
        """Return the derivatives (n, k) of the fit to its coordinates, without those of the effects `out`."""
        if self.fit is None:
            return None
        if not out:
            return self.fit.jacobian
        gone = {e.label for e in out}
        stay = [self.world.effects[a.index].label not in gone for a in self.fit.space.axes]
        return self.fit.jacobian[:, stay]

    def brought(self, placed: EffectInstance) -> tuple[Trial, list[Trial]] | None:
        """Return the step that added an effect alone, if the other effects are still those of that step.

        Then the other candidates of the step were tried in its place. None otherwise. Steps in which nothing else was
        tried are skipped.
        """
        beside = {e.label for e in self.world.effects} - {placed.label}
        for best, trials in self.steps[::-1]:
            if best.score.has(placed) and len(trials) > 1:
                alone = best.score.count == 1 and not best.score.out
                same = {e.label for e in best.fit.world.effects} - {placed.label} == beside
                return (best, trials) if alone and same else None
        return None

    def grouped(self, placed: EffectInstance) -> bool:
        """Return whether an effect was added as one of a group, without a test of its own."""
        came = [best.score for best, _ in self.steps if best.score.has(placed)]
        return bool(came) and bool(came[-1].beside)

    @property
    def scale(self) -> float:
        """Held-out excess over noise that an accepted effect typically removed (geometric mean); at first, all of it.

        The error of a law's form is proportional to what the law removed. With the geometric mean, small effects are
        not judged against one dominant effect alone.
        """
        removed = [best.gain.mean / best.score.count for best, _ in self.steps if best.gain.mean > 0]
        return float(stats.gmean(removed)) if removed else max(self.first - 1.0, 1e-9)

    def removed_by(self, placed: EffectInstance, before: int | None = None) -> float:
        """Return an effect's share of the held-out excess that its step removed, including that of effects it replaced;
        all of the excess for an effect of the user's model. Steps from number `before` on do not count.
        """
        for k in range(len(self.steps) if before is None else before)[::-1]:
            best = self.steps[k][0]
            if best.score.has(placed):
                return (best.gain.mean + sum(self.removed_by(e, k) for e in best.score.out)) / best.score.count
        return max(self.first - 1.0, 1e-9)


def without(world: World, effects: Sequence[EffectInstance]) -> World:
    """Return the world without some of its effects."""
    for e in effects:
        world = world.without(e.effect, e.where)
    return world
