"""How the page's uPlot charts draw samples with gaps: their data cannot hold a gap, and NaN does not end a line."""

from __future__ import annotations

from typing import Any

import numpy as np

SEEN = 0.01  # share of a chart's width below which a line over a gap is not noticed


def pen(time: np.ndarray, colour: str, width: float) -> dict[str, Any]:
    """Return how to draw samples at `time` (n,), s: a line of a width in px, or dots if there are gaps in it."""
    steps = np.diff(time)
    usual = 1.5 * np.quantile(steps, 0.9) if steps.size else 0.0
    if (steps > max(usual, SEEN * steps.sum())).any():
        return {
            "stroke": colour,
            "width": 0,
            "points": {"show": True, "size": 2, "space": 0, "width": 0, "fill": colour},
        }
    return {"stroke": colour, "width": width, "points": {"show": False}}
