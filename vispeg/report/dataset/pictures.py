"""Turn frames into pictures to view: colour, and colour-coded depth and parts, side by side."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence

import numpy as np

from vispeg.datasets.codec import encode
from vispeg.datasets.formats.read_bop import Bop
from vispeg.datasets.layout import colour_of, depth_of
from vispeg.datasets.read import Dataset
from vispeg.render.image_kinds import depth_picture

SIDE = 96  # px, height of a picture
GAP, GREY = 4, 235  # gap between pictures, px, and its grey value
# one colour per part, suitable for colour-blind readers too (Okabe and Ito, "Color Universal Design")
PALETTE = np.array(
    [
        [20, 20, 20],
        [230, 159, 0],
        [86, 180, 233],
        [0, 158, 115],
        [240, 228, 66],
        [0, 114, 178],
        [213, 94, 0],
        [204, 121, 167],
        [150, 150, 150],
    ],
    np.uint8,
)


def depth_range(data: Dataset | Bop, frames: Sequence[Mapping[str, np.ndarray]]) -> dict[str, tuple[float, float]]:
    """Return for each camera with depth its 2nd and 85th percentile, m, so that near depths differ visibly."""
    out = {}
    for name in [name for name in data.cameras if depth_of(name, frames[0]) in frames[0]]:
        depths = np.concatenate([f[depth_of(name, f)].ravel() for f in frames])
        depths = depths[depths > 0]
        low, high = np.percentile(depths, [2, 85]) if len(depths) else (0.0, 1.0)
        out[name] = float(low), float(max(high, low + 1e-3))
    return out


def part_picture(parts: np.ndarray) -> np.ndarray:
    """Colour part numbers (H, W); return (H, W, 3) uint8."""
    return PALETTE[parts % len(PALETTE)]


def views(
    data: Dataset | Bop, frame: Mapping[str, np.ndarray], name: str, limits: tuple[float, float] | None, side: int
) -> list[np.ndarray]:
    """Return a camera's pictures, each `side` px high: colour; depth, if `limits` (m) are given; parts, if labelled."""
    pictures = [frame[colour_of(name)]]
    if limits is not None:
        pictures.append(depth_picture(frame[depth_of(name, frame)], *limits))
    if (labels := frame.get(f"label.parts.{name}")) is not None:
        pictures.append(part_picture(labels))
    return [enlarged(picture, side) for picture in pictures]


def enlarged(image: np.ndarray, side: int) -> np.ndarray:
    """Resize a picture to `side` px in height, with its proportions kept; enlarged pixels stay sharp."""
    import cv2

    width = max(1, round(image.shape[1] * side / image.shape[0]))
    how = cv2.INTER_NEAREST if side >= image.shape[0] else cv2.INTER_AREA
    return cv2.resize(np.ascontiguousarray(image), (width, side), interpolation=how)


def chosen(data: Dataset | Bop, count: int) -> list[int]:
    """Return frame numbers for a contact sheet, from as many episodes as possible and spread over their length."""
    episodes = data.episodes
    if count >= len(data):
        return list(range(len(data)))
    out = set()
    for k in range(count):
        e = episodes[k * len(episodes) // count]
        same = [j for j in range(count) if episodes[j * len(episodes) // count] is e]
        # several frames of an episode are spread evenly over it; a single one, over the episodes, by the golden ratio
        share = (same.index(k) + 0.5) / len(same) if len(same) > 1 else ((k * 0.618034) % 1.0)
        out.add(e["dataset_from_index"] + int(share * e["length"]))
    return sorted(out)


def sheet(data: Dataset | Bop, count: int, width: int = 1800) -> np.ndarray:
    """Return a contact sheet (H, W, 3) uint8: `count` frames, each with every camera's colour, depth and parts.

    Args:
        data: the dataset, with cameras.
        count: number of frames.
        width: approximate width of the sheet, px.
    """
    frames = [data[i] for i in chosen(data, count)]
    limits = depth_range(data, frames)
    tiles = []
    for frame in frames:
        row = [picture for name in data.cameras for picture in views(data, frame, name, limits.get(name), SIDE)]
        tile = np.concatenate([_edged(picture) for picture in row], axis=1)
        tiles.append(np.pad(tile, ((GAP, GAP), (2 * GAP, 2 * GAP), (0, 0)), constant_values=GREY))
    columns = max(1, width // tiles[0].shape[1])
    tiles += [np.full_like(tiles[0], GREY)] * (-len(tiles) % columns)
    rows = [np.concatenate(tiles[i : i + columns], axis=1) for i in range(0, len(tiles), columns)]
    return np.concatenate(rows)


def _edged(image: np.ndarray) -> np.ndarray:
    return np.pad(image, ((1, 1), (1, 1), (0, 0)), constant_values=GREY)


def embedded(image: np.ndarray) -> str:
    """Return a picture as a `data:` link."""
    return "data:image/png;base64," + base64.b64encode(encode(np.ascontiguousarray(image))).decode()
