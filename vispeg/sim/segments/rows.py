"""Segments side by side as the rows of one batch: row = segment * nworld + world, columns by control tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vispeg.sim.segments.segment import Segment

CHUNK = 2**16  # numbers that are repeated at a time: few calls, and still in the cache


class ByTick:
    """`rows[k]` is (nsim, ...) at tick k, from (ticks, nsegment, ...); repeated for every world some ticks at a time.

    What it gives is read, never written: it may be a view of what later calls give too.
    """

    def __init__(self, values: np.ndarray, nworld: int):
        self.values, self.nworld = values, nworld
        self.count = max(1, CHUNK // max(1, values[0].size * nworld))
        self.first, self.some = 0, values[:0]

    def __getitem__(self, k: int) -> np.ndarray:
        if self.nworld == 1:
            return self.values[k]
        if not 0 <= k - self.first < len(self.some):
            self.first = k
            self.some = np.repeat(self.values[k : k + self.count], self.nworld, axis=1)
        return self.some[k - self.first]


class Rows:
    """How the segments and worlds of a rollout lie in its batch.

    Attributes:
        segments: one control mode and tick for all.
        nworld: worlds that each is run with.
        ticks: of the longest segment; the shorter ones are held at their end.
        nsim: rows.
    """

    def __init__(self, segments: Sequence[Segment], nworld: int):
        self.segments, self.nworld = segments, nworld
        self.ticks = max(s.ticks for s in segments)
        self.nsim = nworld * len(segments)

    def by_tick(self, get: Callable[[Segment], np.ndarray]) -> ByTick:
        """Give what `get` says of each segment, (n, ...), by tick."""
        first = get(self.segments[0])
        held = np.empty((self.ticks, len(self.segments), *first.shape[1:]), first.dtype)
        for i, s in enumerate(self.segments):
            value = get(s) if i else first
            held[: len(value), i] = value
            held[len(value) :, i] = value[-1]
        return ByTick(held, self.nworld)

    def constant(self, get: Callable[[Segment], np.ndarray | float | None], width: int) -> np.ndarray:
        """Give what `get` says of each segment, (width,) or a number, as (nsim, width)."""
        rows = [np.broadcast_to(np.asarray(get(s), float), (self.nworld, width)) for s in self.segments]
        return np.concatenate(rows)
