"""Interactive plots of signals: the reader chooses recording, joints and lines; plots share cursor and zoom."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vispeg.core.lines import thinned, thinned_time
from vispeg.report.text.quantities import PREFIXED

SCRIPTS = ("vendored/uPlot.js", "charts.js", "traces.js")
STYLES = ("vendored/uPlot.css",)
BUDGET = 250_000  # most samples of a page in all, at three bytes each
FEWEST, MOST = 300, 4000  # samples of one line
GAP = -32768  # the code of a missing value


@dataclass(frozen=True)
class Line:
    """A line of a panel: the array `of` of a track, minus the array `minus` if given.

    Attributes:
        label: name of the line; lines with the same label are switched on and off together.
        of, minus: names of arrays; a track without them does not have the line.
        colour: name of a colour in the palette.
        width: width of the line, px.
        dash: draw a dashed line.
        dots: draw dots in place of a line.
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
    """A plot that each channel has: name, unit and lines; `visible` says whether it is shown at first."""

    name: str
    unit: str
    lines: tuple[Line, ...]
    visible: bool = True


@dataclass(frozen=True)
class Track:
    """A recording: time (n,), s, and arrays (n, channels) with NaN in gaps; `bands` (from, to), s, are shaded."""

    name: str
    time: np.ndarray
    arrays: Mapping[str, np.ndarray]
    bands: Sequence[tuple[float, float]] = field(default=())


def widget(
    channels: Sequence[str], panels: Sequence[Panel], tracks: Sequence[Track], visible: Sequence[bool]
) -> dict[str, object]:
    """Return the values for the template `traces.html.j2`.

    Args:
        channels: names of the columns, such as joints.
        panels: the plots; those without any data in the tracks are left out.
        tracks: one or more recordings.
        visible: whether each channel is shown at first.
    """
    available = {key for track in tracks for key in track.arrays}
    used = [p for p in panels if any({line.of, line.minus or line.of} <= available for line in p.lines)]
    lines = {line.label: line for panel in used for line in panel.lines if line.of in available}
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
    """Return JSON in which `<` is escaped, so that it cannot end or begin HTML markup."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def coded(values: np.ndarray) -> dict[str, object]:
    """Encode (rows, n) as 16-bit integers in base64, each row with its own scale; GAP encodes NaN."""
    values = np.where(np.isfinite(values), values, np.nan)
    scale = np.max(np.abs(np.nan_to_num(values)), axis=1, initial=0.0, keepdims=True) / 32767
    safe = np.where(scale > 0, scale, 1.0)
    gap = np.isnan(values)
    codes = np.where(gap, GAP, np.round(np.where(gap, 0.0, values) / safe)).astype("<i2")
    return {
        "scale": [float(f"{s:.6g}") for s in safe[:, 0]],
        "codes": base64.b64encode(np.ascontiguousarray(codes).tobytes()).decode(),
    }


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
