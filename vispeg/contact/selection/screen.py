"""Screen: gain of one size of an effect added to a world whose free effects are refitted, to first order.

Without the refit, correlated effects hide each other: friction fitted alone also explains part of a compliant fixture,
so that with friction fixed no size of the compliance would lower the residual. Source: Frisch and Waugh 1933, Partial
time regressions as compared with individual trends, Econometrica 1(4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.contact.evidence import ContactEvidence
from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.identify.space import Space
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Probe:
    """One size of one parameter of an effect.

    Attributes:
        placed: the effect with this size.
        name: name of the parameter.
        gain: drop of the squared whitened residual; -inf if `moved` is no more than a solver's chatter makes.
        moved: squared norm of the change of that residual.
    """

    placed: EffectInstance
    name: str
    gain: float
    moved: float = np.inf

    @property
    def key(self) -> tuple[str, str]:
        """(effect, place)."""
        return self.placed.effect, self.placed.where

    @property
    def promise(self) -> float:
        """Gain of the best size if the residual changes in proportion to the size; `gain` if it promises no drop."""
        along = 0.5 * (self.gain + self.moved)
        return along**2 / self.moved if along > 0 else self.gain


class Screen:
    """Probes of effects of given sizes added to a world; each is simulated once.

    Args:
        evidence: the recordings.
        world: the world to which each effect is added.
        free: indices of the world's effects that are refitted.

    Attributes:
        base: the world's residual (m,) after the refit.
        basis: orthonormal basis (m, k) of the changes that the free parameters make.
        known: the probes so far.
    """

    def __init__(self, evidence: ContactEvidence, world: World, free: Sequence[int]):
        self.evidence, self.world = evidence, world
        space = Space(world, free, evidence)
        near = [space.at(space.start + step) for step in np.diag(space.steps(space.start))]
        base, *moved = evidence.residuals([world, *near])
        changes = np.reshape(moved, (len(moved), len(base))) - base
        _, length, ways = np.linalg.svd(changes, full_matrices=False)
        self.basis = ways[length**2 > chatter()].T
        self.base = self._refitted(base)
        self.known: dict[tuple[str, str], Probe] = {}

    def ask(self, tries: Sequence[tuple[str, EffectInstance]]) -> list[Probe]:
        """Return the probe of each (parameter, effect with one size of it)."""
        new = [t for t in tries if _key(*t) not in self.known]
        for t, r in zip(new, self.evidence.residuals([self.world.add(e) for _, e in new]), strict=True):
            rest = self._refitted(r)
            moved = float(np.sum((rest - self.base) ** 2))
            gain = float(self.base @ self.base - rest @ rest) if moved > chatter() else -np.inf
            self.known[_key(*t)] = Probe(t[1], t[0], gain, moved)
        return [self.known[_key(*t)] for t in tries]

    def gain(self, placed: EffectInstance) -> float:
        """Return the drop of the squared residual by an effect at its value, at least 0."""
        (probe,) = self.ask([("", placed)])
        return max(probe.gain, 0.0)

    def _refitted(self, residual: np.ndarray) -> np.ndarray:
        return residual - self.basis @ (self.basis.T @ residual)


def _key(parameter: str, placed: EffectInstance) -> tuple[str, str]:
    return parameter, model_text(World(effects=(placed,)))


def chatter() -> float:
    """Return the most by which a solver's chatter changes the squared residual."""
    return RULES.chatter * RULES.contact_rough
