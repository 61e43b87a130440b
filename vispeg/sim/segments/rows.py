"""Segments side by side as the rows of one batch: row = segment * nworld + world, columns by control tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vispeg.sim.segments.segment import Segment

CHUNK = 2**16  # numbers repeated per call: few calls, and still within the CPU cache


class ByTick:
    """Values by tick: `rows[k]` is (nsim, ...) at tick k, the values of the segments repeated for every world.

    Values are repeated for a block of ticks at a time. Do not write to a result: it may be a view that later calls
    return too.

    Args:
        values: (ticks, nsegment, ...).
        nworld: number of worlds.
    """

    def __init__(self, values: np.ndarray, nworld: int):
        self.values, self.nworld = values, nworld
        self.count = max(1, CHUNK // max(1, values[0].size * nworld))
        self.first, self.block = 0, values[:0]  # tick at which the block begins, and its values

    def __getitem__(self, k: int) -> np.ndarray:
        if self.nworld == 1:
            return self.values[k]
        if not 0 <= k - self.first < len(self.block):
            self.first = k
            self.block = np.repeat(self.values[k : k + self.count], self.nworld, axis=1)
        return self.block[k - self.first]


class Rows:
    """Layout of the segments and worlds of a rollout in its batch.

    Attributes:
        segments: segments with the same control mode and tick.
        nworld: number of worlds that each segment is run with.
        ticks: length of the longest segment; shorter ones are held at their end.
        nsim: number of rows.
    """

    def __init__(self, segments: Sequence[Segment], nworld: int):
        self.segments, self.nworld = segments, nworld
        self.ticks = max(s.ticks for s in segments)
        self.nsim = nworld * len(segments)

    def by_tick(self, get: Callable[[Segment], np.ndarray]) -> ByTick:
        """Arrange the arrays (n, ...) that `get` returns for each segment by tick."""
        first = get(self.segments[0])
        held = np.empty((self.ticks, len(self.segments), *first.shape[1:]), first.dtype)
        for i, s in enumerate(self.segments):
            value = get(s) if i else first
            held[: len(value), i] = value
            held[len(value) :, i] = value[-1]
        return ByTick(held, self.nworld)

    def constant(self, get: Callable[[Segment], np.ndarray | float | None], width: int) -> np.ndarray:
        """Arrange the values that `get` returns for each segment, (width,) or a number, as (nsim, width)."""
        rows = [np.broadcast_to(np.asarray(get(s), float), (self.nworld, width)) for s in self.segments]
        return np.concatenate(rows)
