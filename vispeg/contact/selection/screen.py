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
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.identify.space import Space
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Probe:
    """One size of one parameter of an effect.

    Attributes:
        placed: the effect with this size.
        name: name of the parameter.
        gain: drop of the squared whitened residual; -inf if `moved` is not above `felt` squared.
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
    """Gains of effects of given sizes added to a world, and their linear extrapolation.

    Args:
        evidence: the recordings.
        world: the world to which each effect is added.
        free: indices of the world's effects that are refitted.

    Attributes:
        part: see `ContactEvidence`.
        residuals: by `part`, the function from worlds to their residuals on one in `part` pieces of the recordings.
            Squares on a part are multiplied by `part`, so that they stand for all of the recordings.
        near: the world with each free parameter moved by one step.
        base: by `part`, the world's residual (m,) after the refit and an orthonormal basis (m, k) of the changes that
            the free parameters make.
    """

    def __init__(self, evidence: ContactEvidence, world: World, free: Sequence[int]):
        self.world, self.part = world, evidence.part
        self.residuals = {self.part: evidence.residuals_in_part, 1: evidence.residuals}
        space = Space(world, free, evidence)
        u = space.start
        self.near = [space.at(u + step) for step in np.diag(space.steps(u))] if len(u) else []
        self.base: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def ask(self, tries: Sequence[tuple[str, EffectInstance]], in_part: bool = True) -> tuple[list[Probe], list[float]]:
        """Return for each (parameter, effect with its size) a probe and the gain that linear extrapolation promises.

        With `in_part` only a part of the recordings is simulated, except for effects with memory, such as a part that
        slipped in its grip: their state depends on all that came before.
        """
        parts = [self.part if in_part and not effect(placed.effect).remembers else 1 for _, placed in tries]
        out: dict[int, tuple[Probe, float]] = {}
        for part, residuals in self.residuals.items():
            asked = [k for k, p in enumerate(parts) if p == part]
            if not asked:
                continue
            if part not in self.base:
                self.base[part] = self._begin(part)
            base, basis = self.base[part]
            for k, r in zip(asked, residuals([self.world.add(tries[k][1]) for k in asked]), strict=True):
                rest = r - basis @ (basis.T @ r)
                out[k] = _probe(*tries[k], base, rest, part), _promised(base, rest, part)
        return [out[k][0] for k in range(len(tries))], [out[k][1] for k in range(len(tries))]

    def gain(self, placed: EffectInstance) -> float:
        """Return the drop of the squared residual on all of the recordings by an effect at its value, at least 0."""
        (probe,) = self.ask([("", placed)], in_part=False)[0]
        return max(float(probe.gain), 0.0)

    def _begin(self, part: int) -> tuple[np.ndarray, np.ndarray]:
        """Return `base` of a part."""
        base, *near = self.residuals[part]([self.world, *self.near])
        basis = _basis([r - base for r in near], len(base), RULES.felt**2 / part)
        return base - basis @ (basis.T @ base), basis


def _basis(changes: Sequence[np.ndarray], size: int, least: float) -> np.ndarray:
    """Return an orthonormal basis (size, k) of the changes with a squared norm over `least`."""
    felt = [c for c in changes if c @ c > least]
    if not felt:
        return np.zeros((size, 0))
    u, length, _ = np.linalg.svd(np.stack([c / np.linalg.norm(c) for c in felt], axis=1), full_matrices=False)
    return u[:, length > RULES.screen_flat * length[0]]


def _promised(base: np.ndarray, r: np.ndarray, part: int) -> float:
    """Return the drop of the squared residual at the best size by linear extrapolation; 0 if none promises a drop.

    Unlike `Probe.promise`, it counts changes too small to be felt: a larger size may be.
    """
    change = r - base
    along = float(base @ change)
    return part * along**2 / max(float(change @ change), 1e-12) if along < 0 else 0.0


def _probe(name: str, placed: EffectInstance, base: np.ndarray, r: np.ndarray, part: int) -> Probe:
    """Return the probe of an effect by the residuals (m,) without it, `base`, and with it, `r`, both refitted."""
    moved = part * float(np.sum((r - base) ** 2))
    return Probe(placed, name, part * float(base @ base - r @ r) if moved > RULES.felt**2 else -np.inf, moved)
