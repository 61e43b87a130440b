"""Windows of a long recording that are simulated: the parts near contact, and some free air spread over time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.contact.phases import Phases
from vispeg.core.rules import RULES
from vispeg.recordings.regimes import IMPACT

CHUNK, LEAD = 12, 3  # blocks chosen at a time; blocks until a window is independent of its start
NEAR = 3  # blocks of free air around a contact that show when it begins
FREE = 2.0  # s of free air that are simulated


def thinned(phase: Phases, seconds: float) -> Phases:
    """Return the phases with windows of about `seconds`; a shorter path is used whole."""
    m = len(phase.time)
    block = float(phase.time[1] - phase.time[0]) if m > 1 else 1.0
    first = int(np.flatnonzero(phase.resting)[-1]) + 1
    close = np.convolve(phase.near, np.ones(2 * NEAR + 1), "same") > 0
    chosen = _spread(close, seconds / block) | _spread(~close, min(FREE, seconds) / block)
    chosen[:first] = False
    chosen &= phase.code != IMPACT  # the smoothed path would give another impact, in which the grip may slip
    driven = np.zeros(m, bool)
    used = chosen.copy()
    for start in np.flatnonzero(chosen & ~np.r_[False, chosen[:-1]]):
        # the window begins LEAD blocks earlier, or as many as follow an impact; chosen ones make up for those that lack
        before = phase.code[max(start - LEAD, 0) : start]
        lead = int(np.argmin(np.r_[before[::-1] != IMPACT, False]))
        driven[start - lead : start] = True
        used[start : start + LEAD - lead] = False
    driven |= chosen
    edges = np.flatnonzero(np.diff(np.r_[0, driven.astype(int), 0]))
    windows = tuple(slice(a * phase.size, b * phase.size) for a, b in zip(edges[::2], edges[1::2], strict=True))
    return replace(phase, used=used, windows=windows)


def without(phase: Phases, read: np.ndarray) -> Phases:
    """Return the phases without blocks that were mostly not `read` (n,), and without those after a long gap.

    A gap is bridged by a straight line, whose effect on the hand takes `LEAD` blocks to decay.
    """
    m = len(phase.time)
    lost = read[: m * phase.size].reshape(m, phase.size).mean(axis=1) < RULES.block_read
    if not lost.any():
        return phase
    after = np.convolve(lost, np.ones(LEAD + 1), "full")[:m] > 0
    return replace(phase, used=phase.used & ~after, resting=phase.resting & ~lost)


def _spread(flag: np.ndarray, most: float) -> np.ndarray:
    """Return about `most` of the flagged blocks, (m,) bool, in chunks spread evenly; all if there are no more."""
    rows = np.flatnonzero(flag)
    chunks = np.array_split(rows, max(1, len(rows) // CHUNK))
    count = max(1, min(len(chunks), int(most / CHUNK)))
    chosen = np.linspace(0, len(chunks) - 1, count).round().astype(int)
    out = np.zeros(len(flag), bool)
    out[np.concatenate([chunks[k] for k in chosen])] = True
    return out
