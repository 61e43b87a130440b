"""Sentences on compared pictures, one per camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vispeg.core.counts import count
from vispeg.report.record import rows
from vispeg.report.text.quantities import plain


def cameras(values: Mapping[str, Any]) -> list[str]:
    """Return a sentence per camera on the errors of its borders, depth and colour; empty without pictures."""
    section = values.get("pictures")
    return [sentence(camera) for camera in rows(section if isinstance(section, dict) else {}, "cameras")]


def sentence(camera: Mapping[str, Any]) -> str:
    """Return a camera's sentence: `wrist_wide, 45 frames: borders 3.8 px off (median), depth 5.2 mm off (median)`."""
    parts = []
    for key, words in (
        ("border_median_px", "borders {} px off (median)"),
        ("depth_median_mm", "depth {} mm off (median)"),
        ("grey", "colour {} grey levels off (RMS)"),
    ):
        value = camera.get(key)
        if isinstance(value, int | float):
            parts.append(words.format(plain(float(value), 2)))
    frames = camera.get("frames")
    head = f"{camera.get('camera', '?')}, {count(frames, 'frame') if isinstance(frames, int) else '? frames'}"
    return f"{head}: {', '.join(parts) or 'nothing to compare'}"


def projections(views: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each camera whose images are shifted.

    For example `wrist_wide: the picture is shifted by 5.21 px at 0.15 m, 4.80 px at 0.25 m (RMS over the image, 1 sigma
    0.03 px)`.
    """
    out = []
    for camera in dict.fromkeys(str(row["camera"]) for row in rows(views, "projection")):
        maps = [row for row in rows(views, "projection") if row["camera"] == camera]
        if any(row["rms_px"] > 0 for row in maps):
            sigma = max(row["uncertainty_px"] for row in maps)
            shift = f"the picture is shifted by {_distances(maps)} (RMS over the image, 1 sigma {sigma:.2f} px)"
            out.append(f"{camera}: {shift}")
    return out


def confounded(views: Mapping[str, Any]) -> list[str]:
    """Return a sentence per pair of effects that the views cannot distinguish, with a motion that would."""
    out = []
    for row in rows(views, "confounded"):
        shifts = f"; over the image {_distances(rows(row, 'projection'))}" if row["projection"] else ""
        pair = f"{row['effect']} and {row['rival']}"
        out.append(f"{pair}: {row['views_px']:.2f} px apart in these views{shifts}. To tell them: {row['motion']}")
    return out


def _distances(maps: Sequence[Mapping[str, Any]]) -> str:
    return ", ".join(f"{row['rms_px']:.2f} px at {row['distance_m']:g} m" for row in maps)
