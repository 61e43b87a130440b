"""Procedural patterns that tile without a seam, each (128, 128) in [0, 1], from a random generator alone.

Sources: gradient noise, K. Perlin, Improving noise, SIGGRAPH 2002 (fade polynomial); simplex noise on a sheared grid
whose periods fit a square, S. Gustavson and I. McEwan, JCGT 11(1), 2022. A cell is one feature; there are `CELLS` of
them along an edge, so a tile that is `CELLS` times as wide as a feature should be has features of that size.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

SIZE = 128  # px along an edge
CELLS = 8  # features along an edge


def perlin(rng: np.random.Generator, cells: tuple[int, int] = (CELLS, CELLS), octaves: int = 3) -> np.ndarray:
    """Return gradient noise; `cells` are (rows, columns) of the coarsest octave, each further one is twice as fine."""
    total = np.zeros((SIZE, SIZE), np.float32)
    for octave in range(octaves):
        total += _octave(rng, cells[0] << octave, cells[1] << octave) / 2**octave
    return stretch(total)


def simplex(rng: np.random.Generator) -> np.ndarray:
    """Return simplex noise, one octave: kernels (0.8 - r^2)^4 around the corners of a triangular grid."""
    angle = rng.uniform(0, 2 * np.pi, (CELLS, 2 * CELLS)).astype(np.float32)  # indexed by row and half columns
    y, x = _grid(CELLS, CELLS)
    u = x + 0.5 * y  # sheared, so that triangles are halves of squares
    i, j = np.floor(u).astype(int), np.floor(y).astype(int)
    right = (u - i) > (y - j)
    total = np.zeros((SIZE, SIZE), np.float32)
    for di, dj in ((0, 0), (np.where(right, 1, 0), np.where(right, 0, 1)), (1, 1)):
        ci, cj = i + di, j + dj
        turn = angle[cj % CELLS, (2 * ci - cj) % (2 * CELLS)]
        dx, dy = x - (ci - 0.5 * cj), y - cj
        total += np.maximum(0.8 - dx**2 - dy**2, 0) ** 4 * (np.cos(turn) * dx + np.sin(turn) * dy)
    return stretch(total)


def checkerboard(rng: np.random.Generator) -> np.ndarray:
    """Return black and white squares, shifted at random."""
    y, x = _grid(CELLS, CELLS, rng)
    return ((np.floor(x) + np.floor(y)) % 2).astype(np.float32)


def gradient(rng: np.random.Generator) -> np.ndarray:
    """Return a ramp that rises and falls once across the tile, in one of eight directions."""
    return np.abs(2 * (_wave(rng, 1) % 1) - 1).astype(np.float32)


def stripes(rng: np.random.Generator) -> np.ndarray:
    """Return stripes in a random direction, of which a third to two thirds of the width is white."""
    return (_wave(rng, CELLS) % 1 < rng.uniform(1 / 3, 2 / 3)).astype(np.float32)


def wood(rng: np.random.Generator) -> np.ndarray:
    """Return wood cut lengthwise: stripes bent by slow noise, with a fine grain along them."""
    _, x = _grid(CELLS // 2, CELLS // 2, rng)
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (x + 0.8 * perlin(rng, (1, 2), 2)))
    return stretch(rings**2 + 0.5 * perlin(rng, (4, 64), 1))


def brushed_metal(rng: np.random.Generator) -> np.ndarray:
    """Return scratches along the rows: noise much longer than wide, plus slow noise."""
    spectrum = np.fft.rfft(rng.standard_normal((SIZE, SIZE)), axis=1)
    spectrum *= 1 / (1 + (np.arange(spectrum.shape[1]) / 2.0) ** 2)  # keeps low frequencies
    return stretch(np.fft.irfft(spectrum, SIZE, axis=1).astype(np.float32) + 0.15 * perlin(rng, (1, 4), 1))


KINDS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    f.__name__: f for f in (perlin, simplex, checkerboard, gradient, stripes, wood, brushed_metal)
}


def stretch(values: np.ndarray) -> np.ndarray:
    """Scale a pattern to the range 0 to 1, float32."""
    low, high = values.min(), values.max()
    return ((values - low) / max(float(high - low), 1e-9)).astype(np.float32)


def _grid(rows: int, columns: int, rng: np.random.Generator | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column coordinates (SIZE, SIZE) of pixel centres in cells, shifted at random by `rng` if given."""
    shift = rng.uniform(0, 1, 2) * (rows, columns) if rng is not None else (0.0, 0.0)
    t = (np.arange(SIZE, dtype=np.float32) + 0.5) / SIZE
    y, x = np.meshgrid(t * rows + shift[0], t * columns + shift[1], indexing="ij")
    return y.astype(np.float32), x.astype(np.float32)


def _wave(rng: np.random.Generator, cells: int) -> np.ndarray:
    """Return a phase (SIZE, SIZE), about `cells` periods across the tile, in a random direction in which it tiles."""
    angle = rng.uniform(0, 2 * np.pi)
    m, n = round(cells * np.cos(angle)), round(cells * np.sin(angle))
    y, x = _grid(1, 1)
    return m * x + n * y + rng.uniform()


def _octave(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Return one octave: the sum over a cell's corners of weight(y) weight(x) (slope . offset), by matrix products."""
    angle = rng.uniform(0, 2 * np.pi, (rows, columns))
    (wy, ry), (wx, rx) = _hats(rows), _hats(columns)
    return (ry @ np.sin(angle) @ wx.T + wy @ np.cos(angle) @ rx.T).astype(np.float32)


@lru_cache
def _hats(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the weight (SIZE, cells) of each corner in each pixel along an edge, and the weight times the offset.

    The offset is the pixel's distance from the corner, in cells.
    """
    t = (np.arange(SIZE) + 0.5) / SIZE * cells
    near = t.astype(int)
    f = t - near
    s = f**3 * (f * (6 * f - 15) + 10)
    weight, offset = np.zeros((SIZE, cells)), np.zeros((SIZE, cells))
    for d, w in ((0, 1 - s), (1, s)):
        at = np.arange(SIZE), (near + d) % cells
        np.add.at(weight, at, w)  # with one cell both corners are the same
        np.add.at(offset, at, w * (f - d))
    return weight, offset
