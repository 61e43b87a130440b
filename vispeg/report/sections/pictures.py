"""The section on pictures: the worst frames, measured and rendered, and the residuals of each camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vispeg.report.drawings.camera_residuals import residual_figure
from vispeg.report.drawings.figures import chart
from vispeg.report.record import Record, rows, still
from vispeg.report.text.camera_words import sentence
from vispeg.report.text.quantities import plain

TITLE = "What the cameras saw"
SAID = (  # figures of a frame, in its title: key, words
    ("border_px", "borders {} px RMS"),
    ("corner_px", "corners {} px RMS"),
    ("depth_mm", "depth {} mm RMS"),
    ("grey", "{} grey levels"),
)
LABELS = {
    "rendered": "model",
    "measured": "measured",
    "difference": "difference",
    "depth_rendered": "depth, model",
    "depth_measured": "depth, measured",
    "depth_difference": "depth, difference",
}
FIGURES = (  # figures of a camera: key, unit, words
    ("border_median_px", "px", "error of borders, median"),
    ("border_px", "px", "error of borders, RMS"),
    ("corner_median_px", "px", "error of the board's corners, median"),
    ("corner_px", "px", "error of the board's corners, RMS"),
    ("depth_median_mm", "mm", "error of depth, median"),
    ("depth_bias_mm", "mm", "measured minus modelled depth, median"),
    ("grey", "grey levels", "error of colour, RMS"),
    ("fill_rate", "%", "fill rate"),
    ("z_accuracy", "%", "Z-accuracy"),
    ("plane_fit_rms_mm", "mm", "plane-fit RMS"),
    ("subpixel_rms", "px", "sub-pixel RMS"),
)


def context(record: Record) -> Mapping[str, object] | None:
    """Return figures by camera, pictures of the worst frames, and drawn residuals; None without cameras."""
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
    for key, words in SAID:
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
    start = f"camera/{number}/"
    samples = {name.removeprefix(start): values for name, values in arrays.items() if name.startswith(start)}
    return chart(lambda shape: residual_figure(samples, frames, shape), f"camera{number}", sentence(camera))
