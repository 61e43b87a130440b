"""Recorded signals that the reader can look at: which recording, which joints, which lines; one cursor, one zoom."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vispeg.report.text.quantities import PREFIXED

SCRIPTS = ("vendored/uPlot.js", "charts.js", "traces.js")
STYLES = ("vendored/uPlot.css",)
BUDGET = 250_000  # samples of a page in all; three bytes each in the page
FEWEST, MOST = 300, 4000  # of one line
GAP = -32768  # the code of a missing value


@dataclass(frozen=True)
class Line:
    """A line of a panel: the array `of` of a track, less the array `minus`. Lines of one label are switched together.

    Attributes:
        label, of, minus: see above; a track without the arrays does not have the line.
        colour: a name of the palette.
        width: px.
        dash, dots: a broken line; marks in place of a line.
    """

    label: str
    of: str
    colour: str
    minus: str = ""
    width: float = 1.2
    dash: bool = False
    dots: bool = False


@dataclass(frozen=True)
class Panel:
    """What is drawn in one frame for each joint; `visible` at first."""

    name: str
    unit: str
    lines: tuple[Line, ...]
    visible: bool = True


@dataclass(frozen=True)
class Track:
    """A recording: time (n,) s and arrays (n, channels); NaN is a gap. `bands`: (from, to) s, shaded."""

    name: str
    time: np.ndarray
    arrays: Mapping[str, np.ndarray]
    bands: Sequence[tuple[float, float]] = field(default=())


def widget(
    channels: Sequence[str], panels: Sequence[Panel], tracks: Sequence[Track], visible: Sequence[bool]
) -> dict[str, object]:
    """Give what the template `traces.html.j2` shows.

    Args:
        channels: names of the columns, such as joints.
        panels: with lines of which one track at least has the arrays.
        tracks: one or more.
        visible: which channels are drawn at first.
    """
    there = {key for track in tracks for key in track.arrays}
    used = [p for p in panels if any({line.of, line.minus or line.of} <= there for line in p.lines)]
    lines = {line.label: line for panel in used for line in panel.lines if line.of in there}
    rows = len(channels) * sum(len(track.arrays) for track in tracks)
    most = int(np.clip(BUDGET / max(rows, 1), FEWEST, MOST))
    data = {
        "channels": list(channels),
        "lines": list(lines),
        "panels": [_panel(panel) for panel in used],
        "tracks": [_track(track, most) for track in tracks],
    }
    return {
        "channels": list(zip(channels, visible, strict=True)),
        "panels": [(panel.name, panel.visible) for panel in used],
        "lines": [(line.label, line.colour) for line in lines.values()],
        "tracks": [track.name for track in tracks],
        "data": inert(data),
    }


def inert(data: object) -> str:
    """JSON that no HTML parser takes for markup, whatever names are in it."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def coded(values: np.ndarray) -> dict[str, object]:
    """(rows, n) as 16-bit numbers, each row on a scale of its own, so that small ones stay exact; NaN is a gap."""
    values = np.where(np.isfinite(values), values, np.nan)
    scale = np.max(np.abs(np.nan_to_num(values)), axis=1, initial=0.0, keepdims=True) / 32767
    safe = np.where(scale > 0, scale, 1.0)
    gap = np.isnan(values)
    codes = np.where(gap, GAP, np.round(np.where(gap, 0.0, values) / safe)).astype("<i2")
    return {
        "scale": [float(f"{s:.6g}") for s in safe[:, 0]],
        "codes": base64.b64encode(np.ascontiguousarray(codes).tobytes()).decode(),
    }


def thinned(values: np.ndarray, most: int) -> np.ndarray:
    """(n, k) as at most `most` rows in which the least and greatest value of every stretch stand, in their order."""
    n = len(values)
    if n <= most:
        return values
    length = -(-2 * n // most)
    end = n // length * length
    parts = values[:end].reshape(-1, length, values.shape[1])
    low = np.where(np.isfinite(parts), parts, np.inf).argmin(axis=1)
    high = np.where(np.isfinite(parts), parts, -np.inf).argmax(axis=1)
    at = np.stack([np.minimum(low, high), np.maximum(low, high)], axis=1)
    return np.take_along_axis(parts, at, axis=1).reshape(-1, values.shape[1])


def thinned_time(time: np.ndarray, most: int) -> np.ndarray:
    """Give the times (n,) that belong to `thinned` rows: two a stretch, evenly spaced in it."""
    n = len(time)
    if n <= most:
        return time
    length = -(-2 * n // most)
    end = n // length * length
    return time[:end].reshape(-1, length)[:, [length // 4, length - 1 - length // 4]].ravel()


def _panel(panel: Panel) -> dict[str, object]:
    lines = [
        {key: value for key, value in vars(line).items() if value not in ("", False) or key in ("label", "of")}
        for line in panel.lines
    ]
    return {"name": panel.name, "unit": panel.unit, "prefixed": panel.unit in PREFIXED, "lines": lines}


def _track(track: Track, most: int) -> dict[str, object]:
    time = thinned_time(np.asarray(track.time, float), most)
    arrays = {key: coded(thinned(np.asarray(v, float), most).T) for key, v in track.arrays.items()}
    bands = [[round(float(a), 4), round(float(b), 4)] for a, b in track.bands]
    return {"name": track.name, "time": np.round(time, 4).tolist(), "arrays": arrays, "bands": bands}
