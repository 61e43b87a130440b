"""Random numbers for a running batch: one stream a row, so that a row draws the same whatever the batch around it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vispeg.core.seeds import stream

BLOCK = 64  # ticks drawn at once: a generator's call costs more than its numbers


class RowNoise:
    """`noise()` gives (nsim, width) numbers a tick, from a stream keyed by the row's seeds.

    Args:
        name: of the effect, so that two effects with one seed differ.
        seeds: (nsim, n) whole numbers.
        width: numbers a row and tick.
        draw: what is called on a row's generator with a shape.
        active: (nsim,) rows that need numbers; the others get zeros.
    """

    def __init__(
        self,
        name: str,
        seeds: np.ndarray,
        width: int,
        draw: Callable[[np.random.Generator, tuple[int, int]], np.ndarray],
        active: np.ndarray,
    ):
        self.rngs = {
            int(row): stream(int(seeds[row, 0]), name, *seeds[row].astype(np.int64)) for row in np.flatnonzero(active)
        }
        self.block = np.zeros((len(seeds), BLOCK, width))
        self.draw, self.tick = draw, 0

    def __call__(self) -> np.ndarray:
        at = self.tick % BLOCK
        if at == 0:
            for row, rng in self.rngs.items():
                self.block[row] = self.draw(rng, self.block.shape[1:])
        self.tick += 1
        return self.block[:, at]
