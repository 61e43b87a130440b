"""Windows of a long recording: every phase of contact gets its share of what is driven, spread over its time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.contact.phases import NAMES, Phases
from vispeg.recordings.regimes import IMPACT

CHUNK, LEAD = 30, 3  # blocks that are chosen at once; blocks after which a window has forgotten its start
SHARES = dict(zip(NAMES, (0.15, 0.3, 0.35, 0.5, 0.0), strict=True))  # weights of phases that are there


def thinned(phase: Phases, seconds: float) -> Phases:
    """The phases with windows of about so many seconds; all of a path that is no longer."""
    m = len(phase.time)
    block = float(phase.time[1] - phase.time[0]) if m > 1 else 1.0
    first = int(phase.resting.sum())
    if (m - first) * block <= seconds:
        chosen = np.arange(m) >= first
    else:
        chosen = _chosen(phase.code, first, int(seconds / block / CHUNK))
    chosen &= phase.code != IMPACT  # known up to some Hz, a path makes another blow of it, in which a grip may slip
    driven = np.zeros(m, bool)
    used = chosen.copy()
    for start in np.flatnonzero(chosen & ~np.r_[False, chosen[:-1]]):
        before = phase.code[max(start - LEAD, 0) : start]
        lead = int(np.argmin(np.r_[before[::-1] != IMPACT, False]))
        driven[start - lead : start] = True
        used[start : start + LEAD - lead] = False
    driven |= chosen
    edges = np.flatnonzero(np.diff(np.r_[0, driven.astype(int), 0]))
    windows = tuple(slice(a * phase.size, b * phase.size) for a, b in zip(edges[::2], edges[1::2], strict=True))
    return replace(phase, used=used, windows=windows)


def _chosen(code: np.ndarray, first: int, count: int) -> np.ndarray:
    """(m,) bool: `count` chunks after block `first`, phases by their shares, evenly spread within each."""
    starts = np.arange(first, len(code) - CHUNK + 1, CHUNK)
    main = np.array([_rarest(code[s : s + CHUNK]) for s in starts])
    present = {k: starts[main == k] for k in np.unique(main)}
    total = sum(SHARES[NAMES[k]] for k in present)
    out = np.zeros(len(code), bool)
    for k, own in present.items():
        n = min(len(own), max(1, round(count * SHARES[NAMES[k]] / total)))
        for s in own[np.unique(np.linspace(0, len(own) - 1, n).round().astype(int))]:
            out[s : s + CHUNK] = True
    return out


def _rarest(codes: np.ndarray) -> int:
    """The phase that a chunk counts for: of those that last a quarter of it the one that weighs most."""
    names, counts = np.unique(codes, return_counts=True)
    long = names[counts * 4 >= len(codes)]
    return int(max(long, key=lambda k: SHARES[NAMES[k]]))
