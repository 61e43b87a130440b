"""Draw a camera's residuals: a row of three panels (over image, distance and time) for borders, depth and colour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.report.drawings.figures import AFTER, BEFORE, MEASURED, MUTED, Shape, new_figure, quiet
from vispeg.report.text.quantities import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CELLS = (8, 6)  # cells across and down an image, in each of which one displacement is fitted
LEAST = 6  # fewest border points of a cell from which its displacement is fitted
CHANNELS = (  # title with unit, key of the RMS in a frame's row, key of the array over distance, and over the image
    ("borders (px)", "border_px", "border_distance", "along"),
    ("depth (mm)", "depth_mm", "distance", "depth_image"),
    ("colour (grey levels)", "grey", "grey_distance", "grey_image"),
)


def residual_figure(samples: Mapping[str, Any], frames: Sequence[Mapping[str, Any]], shape: Shape) -> Figure | None:
    """Return the figure, with the channels of which at least one frame has an RMS; None if there are none.

    Args:
        samples: name -> array of one camera, from `vispeg.vision.residuals.over_image_and_distance`.
        frames: one row per frame of the camera: its `time`, s, and the RMS of each channel.
        shape: shape of the figure.
    """
    rows = [channel for channel in CHANNELS if any(row.get(channel[1]) is not None for row in frames)]
    if not rows:
        return None
    lines, columns = (3 * len(rows), 1) if shape.narrow else (len(rows), 3)
    figure = new_figure(0.3 + 2.3 * lines, shape.width)
    axes = figure.subplots(lines, columns, squeeze=False).reshape(len(rows), 3)
    for (words, key, distance, image), line in zip(rows, axes, strict=True):
        _over_image(line[0], samples, image, words)
        _over_distance(line[1], samples.get(distance), words)
        _over_time(line[2], frames, key, words)
    return figure


def displacement(pixel: np.ndarray, normal: np.ndarray, along: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Fit a displacement of the borders in each of the m cells of the image that have at least LEAST points.

    A border shows only its displacement along its normal. If all borders in a cell are parallel, the fitted
    displacement is the one along their normal.

    Args:
        pixel: (n, 2) border points, px.
        normal: (n, 2) unit normals.
        along: (n,) displacements along the normals, px.
        size: (2,) width and height of the image, px.

    Returns:
        (m, 5) px: u, v of the cell's centre, displacement du, dv, and RMS of `along` in the cell.
    """
    out = []
    cell = np.clip((pixel / size * CELLS).astype(int), 0, np.array(CELLS) - 1)
    for i in range(CELLS[0]):
        for j in range(CELLS[1]):
            here = (cell[:, 0] == i) & (cell[:, 1] == j)
            if here.sum() < LEAST:
                continue
            n, d = normal[here], along[here]
            weight = 1 / np.maximum(np.abs(d - np.median(d)), 0.5)  # px; outliers count less
            matrix = (n * weight[:, None]).T @ n
            matrix += 1e-3 * np.trace(matrix) * np.eye(2)  # so that parallel borders can be solved too
            du, dv = np.linalg.solve(matrix, (n * weight[:, None]).T @ d)
            middle = (np.array([i, j]) + 0.5) / CELLS * size
            out.append((*middle, du, dv, float(np.sqrt(np.mean(d**2)))))
    return np.array(out).reshape(-1, 5)


def _over_image(ax: Any, samples: Mapping[str, Any], key: str, words: str) -> None:
    """Draw `samples[key]` over the image: for borders (`along`) displacements as arrows, else the RMS as shades."""
    size, values = samples.get("size"), samples.get(key)
    if size is None or values is None or not len(values):
        ax.set_axis_off()
        return
    ax.set_title(f"{words} over the image", color=MUTED, pad=3)
    ax.set_xlim(0, size[0])
    ax.set_ylim(size[1], 0)
    ax.set_aspect("equal")
    ax.set_xticks([])
    ax.set_yticks([])
    for side in ax.spines.values():
        side.set_visible(True)
    if key != "along":
        largest = float(np.nanmax(values)) if np.isfinite(values).any() else 0.0
        ax.imshow(values, cmap="Greys", vmin=0.0, vmax=max(largest, 1e-9), extent=(0, size[0], size[1], 0))
        ax.set_xlabel(f"darkest: {plain(largest, 2)} RMS")
        return
    cells = displacement(samples["pixel"], samples["normal"], values, size)
    if not len(cells):
        return
    longest = float(np.hypot(cells[:, 2], cells[:, 3]).max())
    scale = 0.8 * min(size / CELLS) / max(longest, 1e-6)
    ax.plot(cells[:, 0], cells[:, 1], ".", color=MUTED, markersize=2)
    for u, v, du, dv, _ in cells:
        ax.annotate(
            "", (u + scale * du, v + scale * dv), (u, v), arrowprops={"arrowstyle": "->", "color": BEFORE, "lw": 1.2}
        )
    ax.set_xlabel(f"longest arrow: {plain(longest, 2)} px")


def _over_distance(ax: Any, table: np.ndarray | None, words: str) -> None:
    """Draw median and spread over distance; the columns of `table` (k, 4) are distance (m), median, spread, number."""
    if table is None or not len(table):
        ax.set_axis_off()
        return
    ax.set_title(f"{words} over distance", color=MUTED, pad=3)
    ax.axhline(0.0, color=MUTED, linewidth=0.6)
    ax.plot(table[:, 0], table[:, 1], "o-", color=BEFORE, markersize=3)
    ax.plot(table[:, 0], table[:, 2], "-", color=AFTER)
    ax.text(table[0, 0], table[0, 1], " median", color=BEFORE, va="bottom")
    ax.text(table[-1, 0], table[-1, 2], "spread ", color=AFTER, va="bottom", ha="right")
    ax.set_xlabel("distance (m)")
    quiet(ax)


def _over_time(ax: Any, frames: Sequence[Mapping[str, Any]], key: str, words: str) -> None:
    """Draw the RMS of each frame, `frame[key]`, over time, a line per episode; frames without it are left out."""
    episodes: dict[tuple[Any, Any], list[tuple[float, float]]] = {}
    for row in frames:
        if row.get(key) is not None:
            episodes.setdefault((row.get("recording"), row.get("episode")), []).append((row["time"], row[key]))
    ax.set_title(f"{words} over time, RMS", color=MUTED, pad=3)
    for points in episodes.values():
        ax.plot(*np.array(sorted(points)).T, ".-", color=MEASURED, markersize=4, linewidth=0.8)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("time (s)")
    quiet(ax)
