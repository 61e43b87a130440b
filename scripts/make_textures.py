"""Makes the images in textures/: surfaces (PNG) and environments (Radiance HDR), all procedural.

Example: python scripts/make_textures.py --out textures --overwrite
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from vispeg.core.files import write_bytes_atomic
from vispeg.core.seeds import stream
from vispeg.effects.common.panorama import procedural
from vispeg.effects.common.texture import SIZE, brushed_metal, perlin, simplex, stretch, wood

RNG = np.random.Generator


def oak(rng: RNG) -> np.ndarray:
    """Planks of wood, four across, each with a tone of its own and a dark joint."""
    grain = wood(rng)
    plank = np.arange(SIZE) // (SIZE // 4)
    tone = rng.uniform(0.8, 1.05, 4)[plank] * np.where(np.arange(SIZE) % (SIZE // 4) < 1, 0.55, 1)
    return ramp(grain, (0.45, 0.29, 0.16), (0.76, 0.58, 0.38)) * tone[None, :, None]


def concrete(rng: RNG) -> np.ndarray:
    """Grey clouds with fine grit and pores."""
    base = 0.7 * perlin(rng, (3, 3), 4) + 0.3 * rng.random((SIZE, SIZE))
    base = np.where(perlin(rng, (24, 24), 1) < 0.12, 0.5 * base, base)
    return ramp(stretch(base), (0.42, 0.42, 0.41), (0.72, 0.71, 0.69))


def steel(rng: RNG) -> np.ndarray:
    """Brushed steel."""
    return ramp(brushed_metal(rng), (0.48, 0.50, 0.52), (0.80, 0.81, 0.82))


def cutting_mat(rng: RNG) -> np.ndarray:
    """Return a green mat with a grid, every fourth line bolder."""
    line = np.zeros(SIZE)
    line[::8], line[::32] = 0.35, 0.8
    grid = np.maximum(line[:, None], line[None, :]) + 0.1 * rng.random((SIZE, SIZE))
    return ramp(np.clip(grid, 0, 1), (0.05, 0.33, 0.25), (0.75, 0.86, 0.70))


def fabric(rng: RNG) -> np.ndarray:
    """Return a plain weave of two blues."""
    y, x = np.mgrid[:SIZE, :SIZE]
    over = ((x // 4 + y // 4) % 2).astype(float)
    thread = np.where(over > 0, np.sin(np.pi * (x % 4 + 0.5) / 4), np.sin(np.pi * (y % 4 + 0.5) / 4))
    return ramp(
        np.clip(0.3 * over + 0.5 * thread + 0.2 * rng.random((SIZE, SIZE)), 0, 1),
        (0.10, 0.13, 0.25),
        (0.35, 0.42, 0.62),
    )


def bricks(rng: RNG) -> np.ndarray:
    """Bricks in running bond, eight rows of four."""
    y, x = np.mgrid[:SIZE, :SIZE]
    row = y // 16
    across = (x + 16 * (row % 2)) % SIZE
    tone = rng.uniform(0.2, 1.0, (8, 4))[row, across // 32] * 0.8 + 0.2 * rng.random((SIZE, SIZE))
    image = ramp(tone, (0.42, 0.18, 0.12), (0.72, 0.40, 0.28))
    image[(y % 16 < 2) | (across % 32 < 2)] = (0.74, 0.72, 0.68)
    return image


def marble(rng: RNG) -> np.ndarray:
    """White stone with dark veins along the zero of slow noise."""
    vein = np.abs(perlin(rng, (3, 3), 4) - 0.5) * 2
    return ramp(np.clip(vein / 0.25, 0, 1) ** 0.5, (0.35, 0.36, 0.40), (0.92, 0.91, 0.88))


def terrazzo(rng: RNG) -> np.ndarray:
    """Chips of several colours in light stone."""
    image = ramp(perlin(rng, (4, 4), 3), (0.74, 0.72, 0.68), (0.84, 0.83, 0.79))
    for colour in ((0.55, 0.30, 0.25), (0.25, 0.28, 0.32), (0.60, 0.55, 0.40), (0.35, 0.45, 0.42)):
        image[np.roll(simplex(rng), rng.integers(0, SIZE, 2), (0, 1)) > 0.78] = colour
    return image


SURFACES: tuple[Callable[[RNG], np.ndarray], ...] = (
    oak,
    concrete,
    steel,
    cutting_mat,
    fabric,
    bricks,
    marble,
    terrazzo,
)
ENVIRONMENTS = ("atrium", "hall", "loft", "workshop")  # one seed each
TRAINING, ROWS = 20, 64  # panoramas that training worlds cycle through, and rows of each


def room(rng: RNG, rows: int = ROWS) -> np.ndarray:
    """Return an invented room, (rows, 2 rows, 3) linear light: walls, windows or none, rows of lamps, benches.

    Light of windows is 5 to 40 times that of walls, of lamps 10 to 60 times.
    """
    zenith, azimuth = np.meshgrid(np.arange(rows) + 0.5, np.arange(2 * rows) + 0.5, indexing="ij")
    zenith, azimuth = zenith * np.pi / rows, azimuth * np.pi / rows
    walls = rng.choice([3, 4, 4, 5])
    side = np.floor((azimuth + rng.uniform(0, 2 * np.pi)) / (2 * np.pi) * walls).astype(int) % walls
    across = (azimuth * walls / (2 * np.pi)) % 1.0
    tones = rng.uniform(0.15, 0.9, (walls, 1)) * (1 - rng.uniform(0, 0.5, (walls, 3)))
    out = tones[side]
    edge = rng.uniform(0.35, 0.75)  # rad from the zenith, where the ceiling ends
    out[zenith < edge] = rng.uniform(0.3, 0.9) * (1 - rng.uniform(0, 0.2, 3))
    out[zenith > rng.uniform(1.9, 2.4)] = rng.uniform(0.03, 0.35) * (1 - rng.uniform(0, 0.6, 3))
    daylight = rng.uniform(5, 40) * np.array([rng.uniform(0.7, 1.0), 0.95, rng.uniform(0.8, 1.25)])
    for wall in np.flatnonzero(rng.random(walls) < 0.45):
        panes, high = rng.integers(1, 5), rng.uniform(0.25, 0.5)
        glass = (side == wall) & (np.abs(zenith - rng.uniform(1.1, 1.4)) < high) & ((across * panes) % 1.0 > 0.2)
        out[glass] = daylight
    for wall in np.flatnonzero(rng.random(walls) < 0.6):
        top, part = rng.uniform(1.4, 1.9), rng.uniform(0.1, 0.9)
        out[(side == wall) & (zenith > top) & (np.abs(across - 0.5) < part / 2)] = rng.uniform(0.02, 0.5, 3)
    lamps, wide = rng.integers(0, 7), rng.uniform(0.03, 0.1)
    warm = rng.uniform(10, 60) * np.array([1.0, rng.uniform(0.75, 0.98), rng.uniform(0.5, 1.0)])
    for k in range(lamps):
        near = np.abs(zenith - (0.12 + 0.9 * edge * k / max(lamps, 1))) < wide
        out[near & ((azimuth * rng.integers(1, 4) / np.pi) % 1.0 < rng.uniform(0.3, 0.9))] = warm
    if not lamps and not (out > 2).any():
        out[zenith < 0.3] = warm
    return out.astype(np.float32)


def ramp(t: np.ndarray, dark: tuple[float, ...], light: tuple[float, ...]) -> np.ndarray:
    """Return colours (..., 3) between `dark` at t = 0 and `light` at t = 1."""
    return np.asarray(dark) + t[..., None] * (np.asarray(light) - np.asarray(dark))


def encoded(image: np.ndarray, ending: str) -> bytes:
    """Return an RGB image as the bytes of a file with that ending."""
    ok, data = cv2.imencode(ending, np.ascontiguousarray(image[..., ::-1]))
    if not ok:
        raise RuntimeError(f"OpenCV cannot write {ending}")
    return data.tobytes()


def main() -> None:
    """Write every image."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("textures"))
    parser.add_argument("--overwrite", action="store_true")
    args = parser.parse_args()
    for make in SURFACES:
        image = np.rint(255 * np.clip(make(stream(0, "surface", make.__name__)), 0, 1)).astype(np.uint8)
        path = args.out / "surfaces" / f"{make.__name__}.png"
        write_bytes_atomic(path, encoded(image, ".png"), overwrite=args.overwrite)
    for name in ENVIRONMENTS:
        panorama = procedural(stream(0, "environment", name))
        path = args.out / "environments" / f"{name}.hdr"
        write_bytes_atomic(path, encoded(panorama, ".hdr"), overwrite=args.overwrite)
    for k in range(TRAINING):
        panorama = room(stream(0, "environment", "training", k))
        path = args.out / "environments" / "training" / f"room-{k + 1:02d}.hdr"
        write_bytes_atomic(path, encoded(panorama, ".hdr"), overwrite=args.overwrite)


if __name__ == "__main__":
    main()
