"""Judge worlds on held-out recordings: paired differences of squared residuals, tested over blocks of time.

A block is a short piece of a recording, `RULES.block` seconds long. A loss is a world's summed squared whitened
residual (error over noise) in each block and joint. Null is the value of a parameter at which its effect does nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from vispeg.core.effect import effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Gain
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.identify.loops.noise_motion import reading_floor
from vispeg.worlds.world import World


class Judge:
    """An evidence, usually held out, and the losses (nblock, nj) of worlds on it.

    Attributes:
        blocks: (n,) block of each entry of the flat residual.
        nj: number of joints, or of other columns of a channel.
        cells: (n,) block times nj plus joint, of each entry.
        valid: (n,) whether an entry counts.
        size: (nblock, nj) number of valid readings.
        stretch: (nblock,) stretch of correlated errors to which a block belongs (`Evidence.stretches`).
        last: cache of `cross.on_held_out`: its last fit, and that fit with residual and derivatives on this evidence.
    """

    def __init__(self, evidence: Evidence):
        self.evidence = evidence
        self.blocks = evidence.blocks(RULES.block)
        self.nj = evidence.items[0].nj
        joint = [
            np.broadcast_to(np.arange(i.measured.shape[1]) % i.nj, i.measured.shape).ravel() for i in evidence.items
        ]
        self.cells = self.blocks * self.nj + np.concatenate(joint)
        self.valid = np.concatenate([i.valid.ravel() for i in evidence.items])
        self.size = self._by_cell(self.valid)
        self.stretch = evidence.stretches(self.blocks)
        self.last: tuple[Fit, Fit] | None = None

    def losses(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Return the `loss` of each world."""
        return [self.loss(r) for r in self.evidence.each_residual(worlds)]

    def loss(self, residual: np.ndarray) -> np.ndarray:
        """Return the summed squared whitened residual of each block and joint, (nblock, nj); each square is capped."""
        return self._by_cell(np.minimum(residual**2, RULES.cap) * self.valid)

    def _by_cell(self, values: np.ndarray) -> np.ndarray:
        """Return the sum (nblock, nj) of values (n,), one for each entry of the residual, by block and joint."""
        size = (int(self.blocks.max()) + 1) * self.nj
        return np.bincount(self.cells, weights=values, minlength=size).reshape(-1, self.nj)

    def mean(self, loss: np.ndarray) -> float:
        """Return the mean squared whitened residual of a loss: 1 at the noise floor."""
        return float(loss.sum() / max(self.size.sum(), 1))

    def floor(self, world: World) -> float:
        """Return the mean squared whitened residual of a correct model (`reading_floor`)."""
        return reading_floor(self.evidence, world)

    def excess(self, world: World, loss: np.ndarray) -> float:
        """Return the mean squared whitened residual of a world's loss above that of a correct model."""
        return self.mean(loss) - self.floor(world)

    def apart(self, gain: Gain) -> bool:
        """Return whether a gain distinguishes two worlds by its size alone, however few blocks of time contribute."""
        return gain.mean * self.size.sum() >= self.evidence.decisive

    def tied(self, gain: Gain) -> bool:
        """Return whether chance makes such a gain between equally correct worlds, however many blocks contribute."""
        return gain.mean * self.size.sum() <= self.evidence.tied

    def gain(self, before: np.ndarray, after: np.ndarray, crossed: tuple[np.ndarray, np.ndarray] | None = None) -> Gain:
        """Return the improvement from the loss `before` of one world to the loss `after` of another.

        `crossed` are the cross-fitted losses of the two worlds on the fitted recordings; their blocks join the test.
        """
        read = self.size.sum(axis=1) > 0
        diff = (before - after)[read]
        mean = float(diff.sum() / self.size.sum())
        stretch = np.unique(self.stretch[read], return_inverse=True)[1]
        tested = np.bincount(stretch, weights=diff.sum(axis=1))
        if crossed is not None:
            fitted = (crossed[0] - crossed[1]).sum(axis=1)
            tested = np.concatenate([tested, fitted[fitted != 0]])
        tested = tested[self.evidence.tells(tested)]  # without differences too small to distinguish the worlds
        joints = diff.sum(axis=0) / np.maximum(before.sum(axis=0), 1e-12)
        return Gain(mean, _z(tested), mean / max(self.mean(before), 1e-12), joints)


def _z(diff: np.ndarray) -> float:
    """Return the standard normal score of Wilcoxon's signed-rank test that the differences are above 0."""
    if not np.any(diff):
        return 0.0
    p = stats.wilcoxon(diff, alternative="greater").pvalue
    return float(stats.norm.isf(np.clip(p, 1e-15, 1 - 1e-15)))


def present(fit: Fit, index: int) -> bool:
    """Return whether the effect at `index` of the fit's world is present: one of its magnitudes is clearly not null.

    The 95 % interval of that magnitude excludes null, or the magnitude has no interval. Only the magnitudes that
    `Effect.telling` lists are tested, by default all.
    """
    placed = fit.world.effects[index]
    kind = effect(placed.effect)
    for name in kind.telling or kind.magnitudes:
        v, null = placed.params[name], kind.params[name].null
        if v.low is None or v.high is None:
            return True
        if not v.low <= null <= v.high:
            return True
    return False


def adds(fit: Fit, count: int) -> bool:
    """Return whether at least one of the last `count` effects of a fit is present, see `present`."""
    return any(present(fit, k) for k in range(-count, 0))


def parameters(world: World) -> int:
    """Return the number of parameters of a world's effects, fixed ones included."""
    return sum(len(e.params) for e in world.effects)
