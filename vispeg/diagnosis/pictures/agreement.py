"""Agreement of two recordings on an effect: fitted separately, does it change the images in the same way?

The change of the images due to an effect is the difference between two worlds, with and without it, everything else
refitted in both. So whatever other effects can imitate is not counted: a camera offset is credited only with what a
focal error alone leaves. A real effect makes the same change in both recordings. A spurious one, due to appearance or
to joint errors in a few views, has an arbitrary direction that differs between recordings (mrcal's cross-validation,
applied to one effect; Kogan, mrcal documentation, "a tour of mrcal: cross-validation").
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
    """How an effect changes the held-out images, fitted to two recordings, RMS px.

    Attributes:
        size: change due to the effect as fitted to the first recording, all else refitted.
        apart: difference between the changes fitted to the two recordings.
    """

    size: float
    apart: float

    def doubt(self, least: float) -> str:
        """Return why the effect must not be named, or ""; `least` px is the change due to errors of appearance."""
        if self.size < least:
            return f"others do all but {self.size:.2f} px of what it does, under {least:.2f}"
        if self.apart > RULES.views_apart * self.size:
            return f"two recordings differ by {self.apart:.2f} px on the {self.size:.2f} px that it does"
        return ""


def agreement(search: PictureSearch, added: World, without: World, n_fixed: int) -> Agreement:
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
