"""What cameras delivered against what the model says that they see: the worst frames, and where the residuals lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.report.drawings.figures import AFTER, BEFORE, MEASURED, MUTED, Shape, chart, new_figure, quiet
from vispeg.report.record import Record, rows, still
from vispeg.report.text.camera_words import sentence
from vispeg.report.text.quantities import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "What the cameras saw"
CELLS = (8, 6)  # of an image, for the residuals over it
LEAST = 6  # borders in a cell from which a displacement is told
LABELS = {
    "rendered": "model",
    "measured": "measured",
    "difference": "difference",
    "depth_rendered": "depth, model",
    "depth_measured": "depth, measured",
    "depth_difference": "depth, difference",
}
FIGURES = (  # of a camera: key, unit, words
    ("border_median_px", "px", "borders off, median"),
    ("border_px", "px", "borders off, RMS"),
    ("depth_median_mm", "mm", "depth off, median"),
    ("depth_bias_mm", "mm", "depth too far, median"),
    ("grey", "grey levels", "colour off, RMS"),
    ("fill_rate", "%", "fill rate"),
    ("z_accuracy", "%", "Z-accuracy"),
    ("plane_fit_rms_mm", "mm", "plane-fit RMS"),
    ("subpixel_rms", "px", "sub-pixel RMS"),
)


def context(record: Record) -> Mapping[str, object] | None:
    """Figures by camera, pictures of the worst frames, residuals over image, distance and time; None without frames."""
    section = record.mapping("pictures")
    cameras = rows(section, "cameras")
    if not cameras:
        return None
    arrays = record.evidence.pictures
    pictures = [
        {"title": _title(row), "views": _views(arrays, k)}
        for k, row in enumerate(rows(section, "shown"))
        if row.get("camera")
    ]
    drawn = []
    for number, camera in enumerate(cameras):
        frames = [row for row in rows(section, "frames") if row.get("camera") == camera.get("camera")]
        drawn.append({"title": sentence(camera), "svg": _chart(number, camera, frames, arrays)})
    used = [entry for entry in FIGURES if any(camera.get(entry[0]) is not None for camera in cameras)]
    table = [
        {"words": words, "unit": unit, "cells": [_cell(camera.get(key)) for camera in cameras]}
        for key, unit, words in used
    ]
    names = [str(camera.get("camera", "?")) for camera in cameras]
    return {"names": names, "table": table, "shown": pictures, "drawn": drawn, "frames": len(rows(section, "frames"))}


def _cell(value: Any) -> str:
    return plain(float(value), 2) if isinstance(value, int | float) else "-"


def _title(row: Mapping[str, Any]) -> str:
    parts = [f"{row.get('camera')} at {_cell(row.get('time'))} s of {row.get('recording')}"]
    for key, words in (("border_px", "borders {} px RMS"), ("depth_mm", "depth {} mm RMS"), ("grey", "{} grey levels")):
        if row.get(key) is not None:
            parts.append(words.format(_cell(row[key])))
    return ": ".join([parts[0], ", ".join(parts[1:])]) if parts[1:] else parts[0]


def _views(arrays: Mapping[str, np.ndarray], k: int) -> list[dict[str, str]]:
    return [
        {"link": still(image), "label": label}
        for name, label in LABELS.items()
        if (image := arrays.get(f"picture/{k}/{name}")) is not None
    ]


def _chart(
    number: int, camera: Mapping[str, Any], frames: Sequence[Mapping[str, Any]], arrays: Mapping[str, np.ndarray]
) -> str:
    samples = {name: arrays.get(f"camera/{number}/{name}") for name in ("size", "pixel", "normal", "along", "distance")}
    return chart(lambda shape: _figure(samples, frames, shape), f"camera{number}", sentence(camera))


def _figure(samples: Mapping[str, Any], frames: Sequence[Mapping[str, Any]], shape: Shape) -> Figure | None:
    panels = []
    if samples["along"] is not None and len(samples["along"]):
        panels.append(lambda ax: _over_image(ax, samples))
    if samples["distance"] is not None and len(samples["distance"]):
        panels.append(lambda ax: _over_distance(ax, samples["distance"]))
    panels.append(lambda ax: _over_time(ax, frames))
    if not frames:
        return None
    columns = 1 if shape.narrow else len(panels)
    lines = -(-len(panels) // columns)
    figure = new_figure(0.3 + 2.3 * lines, shape.width)
    axes = figure.subplots(lines, columns, squeeze=False).ravel()
    for ax, draw in zip(axes, panels, strict=False):
        draw(ax)
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    return figure


def displacement(pixel: np.ndarray, normal: np.ndarray, along: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(m, 5) of an image's cells: middle u, v and displacement du, dv in px that fit the normals best, RMS of what is.

    A border tells only how far it moved along its normal; a cell needs borders of several directions.
    """
    out = []
    cell = np.clip((pixel / size * CELLS).astype(int), 0, np.array(CELLS) - 1)
    for i in range(CELLS[0]):
        for j in range(CELLS[1]):
            here = (cell[:, 0] == i) & (cell[:, 1] == j)
            if here.sum() < LEAST:
                continue
            n, d = normal[here], along[here]
            weight = 1 / np.maximum(np.abs(d - np.median(d)), 0.5)
            square = (n * weight[:, None]).T @ n
            square += 1e-3 * np.trace(square) * np.eye(2)  # a cell whose borders all run one way tells one direction
            du, dv = np.linalg.solve(square, (n * weight[:, None]).T @ d)
            middle = (np.array([i, j]) + 0.5) / CELLS * size
            out.append((*middle, du, dv, float(np.sqrt(np.mean(d**2)))))
    return np.array(out).reshape(-1, 5)


def _over_image(ax: Any, samples: Mapping[str, Any]) -> None:
    size = samples["size"]
    cells = displacement(samples["pixel"], samples["normal"], samples["along"], size)
    ax.set_title("over the image: displacement", color=MUTED, pad=3)
    ax.set_xlim(0, size[0])
    ax.set_ylim(size[1], 0)
    ax.set_aspect("equal")
    ax.set_xticks([])
    ax.set_yticks([])
    for side in ax.spines.values():
        side.set_visible(True)
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


def _over_distance(ax: Any, table: np.ndarray) -> None:
    ax.set_title("depth over distance (mm)", color=MUTED, pad=3)
    ax.axhline(0.0, color=MUTED, linewidth=0.6)
    ax.plot(table[:, 0], table[:, 1], "o-", color=BEFORE, markersize=3)
    ax.plot(table[:, 0], table[:, 2], "-", color=AFTER)
    ax.text(table[0, 0], table[0, 1], " median", color=BEFORE, va="bottom")
    ax.text(table[-1, 0], table[-1, 2], "spread ", color=AFTER, va="bottom", ha="right")
    ax.set_xlabel("distance (m)")
    quiet(ax)


def _over_time(ax: Any, frames: Sequence[Mapping[str, Any]]) -> None:
    for key, words in (("border_px", "borders (px)"), ("depth_mm", "depth (mm)"), ("grey", "colour (grey levels)")):
        points = sorted((row["time"], row[key]) for row in frames if row.get(key) is not None)
        if points:
            ax.set_title(f"over time: {words}, RMS", color=MUTED, pad=3)
            ax.plot(*np.array(points).T, ".-", color=MEASURED, markersize=4, linewidth=0.8)
            break
    ax.set_ylim(bottom=0)
    ax.set_xlabel("time (s)")
    quiet(ax)
