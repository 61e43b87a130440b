"""What compared pictures say, in a sentence a camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.record import rows
from vispeg.report.text.quantities import plain


def cameras(values: Mapping[str, Any]) -> list[str]:
    """How far each camera's borders, depth and colour are off; none where a record has no pictures."""
    section = values.get("pictures")
    return [sentence(camera) for camera in rows(section if isinstance(section, dict) else {}, "cameras")]


def sentence(camera: Mapping[str, Any]) -> str:
    """`wrist_wide, 45 frames: borders 3.8 px off, depth 5.2 mm (medians), colour 19 grey levels RMS`."""
    parts = []
    for key, words in (
        ("border_median_px", "borders {} px off (median)"),
        ("depth_median_mm", "depth {} mm off (median)"),
        ("grey", "colour {} grey levels off (RMS)"),
    ):
        value = camera.get(key)
        if isinstance(value, int | float):
            parts.append(words.format(plain(float(value), 2)))
    head = f"{camera.get('camera', '?')}, {camera.get('frames', '?')} frames"
    return f"{head}: {', '.join(parts) or 'nothing to compare'}"
