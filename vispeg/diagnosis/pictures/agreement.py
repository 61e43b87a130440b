"""Does a second recording, fitted by itself, say of an effect what the first one says?

What an effect does to pictures is the difference of two worlds: with it and without it, everything else fitted anew in
both. So what others can do as well counts for none of them: an offset of the camera beside a focal error is worth what
a focal error alone leaves. An effect that is there does the same in either recording. What a look, or an arm's errors
in a few views, make an effect of is of any direction, and another one in the other recording (mrcal's
cross-validation, here of one effect; Kogan, mrcal documentation, "a tour of mrcal: cross-validation").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.core.rules import RULES
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Agreement:
    """What an effect does to the held-out pictures by the first recording, and how far the second one differs, RMS px.

    Attributes:
        size: of the difference that it makes, all else fitted anew.
        apart: of the difference between the two recordings' differences.
    """

    size: float
    apart: float

    def doubt(self, least: float) -> str:
        """Why it is no name, "" where it is one; `least` px is what looks do."""
        if self.size < least:
            return f"others do all but {self.size:.2f} px of what it does, under {least:.2f}"
        if self.apart > RULES.views_apart * self.size:
            return f"two recordings differ by {self.apart:.2f} px on the {self.size:.2f} px that it does"
        return ""


def agreement(search: PictureSearch, added: World, without: World, n_fixed: int) -> Agreement:
    """Of two fitted worlds, one of which has an effect more.

    Args:
        search: of borders.
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
    """(n,) px along the normals between two worlds' borders, at trusted points; NaN at the rest."""
    trusted = np.concatenate([item.valid[:, 0] for item in judged.items])
    a, b = (np.concatenate(judged.misplaced(w)) for w in (first, other))
    return np.where(trusted, a - b, np.nan)


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(x**2))) if np.isfinite(x).any() else 0.0
