"""Windows of a long recording that are simulated: the parts near contact, and some free air spread over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vispeg.contact.phases import Phases
from vispeg.core.rules import RULES
from vispeg.recordings.regimes import IMPACT

CHUNK, LEAD = 12, 3  # blocks chosen at a time; blocks until a window is independent of its start
NEAR = 3  # blocks of free air around a contact that show when it begins
FREE = 2.0  # s of free air that are simulated
PART, PIECE = 3, 12  # a screen simulates at least one in PART pieces, of PIECE blocks each
# s of compared blocks that a screen needs. Errors of the path explain a part of a change of the residual. Of the square
# of the change they leave 10 to 40 times less in 1 to 2 s than in all blocks (compliances and tilts of
# `tests/pressed.py`), and half as much in 6 s (a development case of `scripts/bench/hidden_contact`).
SCREENED = 6.0


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


def part(phases: Sequence[Phases]) -> int:
    """Return n if a screen simulates one in n pieces: about `SCREENED` seconds, or more, as n is at most `PART`."""
    seconds = RULES.contact_block * sum(int(phase.valid.sum()) for phase in phases)
    return max(1, min(PART, round(seconds / SCREENED)))


def pieces(phase: Phases, part: int) -> tuple[slice, ...]:
    """Return every `part`-th piece of the windows, each of up to `PIECE` blocks, as ranges of the path's samples."""
    if part == 1:
        return phase.windows
    size = PIECE * phase.size
    every = [slice(a, min(a + size, w.stop)) for w in phase.windows for a in range(w.start, w.stop, size)]
    return tuple(every[::part])


def driven_blocks(phase: Phases, windows: Sequence[slice]) -> np.ndarray:
    """Return the used blocks in these windows that are independent of the window's start, (m,) bool."""
    out = np.zeros(len(phase.time), bool)
    for w in windows:
        out[w.start // phase.size + LEAD : w.stop // phase.size] = True
    return out & phase.used


def _spread(flag: np.ndarray, most: float) -> np.ndarray:
    """Return about `most` of the flagged blocks, (m,) bool, in chunks spread evenly; all if there are no more."""
    rows = np.flatnonzero(flag)
    chunks = np.array_split(rows, max(1, len(rows) // CHUNK))
    count = max(1, min(len(chunks), int(most / CHUNK)))
    chosen = np.linspace(0, len(chunks) - 1, count).round().astype(int)
    out = np.zeros(len(flag), bool)
    out[np.concatenate([chunks[k] for k in chosen])] = True
    return out
