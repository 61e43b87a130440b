"""Search effects by image edges: a second recording must confirm each, and the others must not replace it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Trial
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.judge import parameters, present
from vispeg.diagnosis.selection.state import State
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.worlds.world import World

OF_TIME = ("camera_delay", "rolling_shutter")  # effects that only motion shows


class BorderSearch(PictureSearch):
    """A search whose effects other effects cannot replace, and that act the same in both recordings."""

    def ways(self, state: State) -> Sequence[Callable[[State], bool]]:
        """Return the moves of `PictureSearch`, then the replacement of effects by simpler or better ones."""
        return (*super().ways(state), self._replace)

    def _replace(self, state: State) -> bool:
        """Replace all effects by one that fits as well, or one effect by a better one; return whether one was removed.

        Removed effects are not added again.
        """
        better, before = self._simpler(state) or self._exchange(state), state.world.effects
        if better is None:
            return False
        self.take(state, *better)
        self._prune(state)
        gone = {e.label for e in before} - {e.label for e in state.world.effects}
        state.replaced |= gone
        return bool(gone)

    def doubt(self, placed: EffectInstance, added: World, without: World, n_fixed: int) -> str:
        """Return why an effect must not be named, or "": others imitate it, or the two recordings disagree on it."""
        return agreement(self, added, without, n_fixed).doubt(self.least_of(placed))

    def least_of(self, placed: EffectInstance) -> float:
        """Return the smallest change of the images, px, with which an effect may be named.

        It is smaller for effects of time, because errors of appearance do not imitate them.
        """
        return RULES.moving_px if placed.effect in OF_TIME else self.least

    def _simpler(self, state: State) -> tuple[Trial, list[Trial]] | None:
        """Return the trial of one effect alone that fits as well as all added ones, and the trials it was chosen from.

        None if there is none. The trials are those of the first step, which each add one effect to the user's model.
        """
        first = state.steps[0][1] if state.steps else []
        # without those that also refit other effects
        trials = [t for t in first if len(t.fit.world.effects) == state.n_fixed + 1]
        if len(state.added) < 2 or not trials:
            return None
        base = replace(state.world, effects=state.world.effects[: state.n_fixed])
        alone = [t for t in trials if not t.rejected and present(t.fit, -1) and equal(self.judge, t.loss, state.loss)]
        alone = [t for t in alone if t.score.placed.label not in state.replaced]
        alone = [t for t in alone if not self.doubt(t.score.placed, t.fit.world, base, state.n_fixed)]
        alone.sort(key=lambda t: (parameters(t.fit.world), float(t.loss.sum())))
        return (alone[0], trials) if alone else None

    def _exchange(self, state: State) -> tuple[Trial, list[Trial]] | None:
        """Return the best trial that replaces one effect by another, and the trials it was chosen from.

        Everything else is refitted. None if no replacement removes a share `exchange` of the held-out error.
        """
        added = [e for e in state.added if e.label not in state.replaced]
        least, replacement = (1.0 - RULES.exchange) * float(state.loss.sum()), None
        for placed in added if len(state.added) > 1 else ():
            reduced = self._without(state, placed)
            places = [p for p in self.places(reduced.world) if p != (placed.effect, placed.where)]
            trials = self.questioned(reduced, self.step(reduced, places))
            trials = [t for t in trials if t.score.placed.label not in state.replaced]
            if trials and not trials[0].rejected and float(trials[0].loss.sum()) < least:
                least, replacement = float(trials[0].loss.sum()), (trials[0], trials)
        return replacement


@dataclass(frozen=True)
class Agreement:
    """How an effect changes the held-out images, fitted to two recordings, RMS px.

    The change of the images due to an effect is the difference between two worlds, with and without it, everything else
    refitted in both. So whatever other effects can imitate is not counted: a camera offset is credited only with what a
    focal error alone leaves. A real effect makes the same change in both recordings. A spurious one, due to appearance
    or to joint errors in a few views, has an arbitrary direction that differs between recordings (mrcal's cross-
    validation, applied to one effect; Kogan, mrcal documentation, "a tour of mrcal: cross-validation").

    Attributes:
        size: change due to the effect as fitted to the first recording, all else refitted.
        apart: difference between the changes fitted to the two recordings.
    """

    size: float
    apart: float

    def doubt(self, least: float) -> str:
        """Return why the effect must not be named, or ""; `least` px is the change due to errors of appearance."""
        if self.size < least:
            return f"other effects imitate its change of the images to within {self.size:.2f} px, less than {least:.2f}"
        if self.apart > RULES.views_apart * self.size:
            return (
                f"its change of the images, {self.size:.2f} px, differs by {self.apart:.2f} px between two recordings"
            )
        return ""


def agreement(search: BorderSearch, added: World, without: World, n_fixed: int) -> Agreement:
    """Compare two fitted worlds, of which `added` has one effect more.

    Args:
        search: the search by borders.
        added, without: the worlds, fitted to the first recording.
        n_fixed: number of effects that are not fitted.
    """
    judged = search.judged
    assert isinstance(judged, BorderEvidence)
    free = [w for w in (added, without) if len(w.effects) > n_fixed]
    again = [f.world for f in search.fits(free, n_fixed, judged)]
    first = _difference(judged, added, without)
    second = _difference(judged, again[0], again[1] if len(free) == 2 else without)
    return Agreement(_rms(first), _rms(first - second))


def _difference(judged: BorderEvidence, first: World, other: World) -> np.ndarray:
    """Return (n,) px along the normals between two worlds' borders, at trusted points; NaN elsewhere."""
    trusted = np.concatenate([item.valid[:, 0] for item in judged.items])
    a, b = (np.concatenate(judged.misplaced(w)) for w in (first, other))
    return np.where(trusted, a - b, np.nan)


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(x**2))) if np.isfinite(x).any() else 0.0
