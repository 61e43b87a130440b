"""The section of maps: each joint's residual over speed, load, position, phase, time and frequency."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.report.drawings.figures import MEASURED, MUTED, Shape, chart, new_figure
from vispeg.report.drawings.palette import day
from vispeg.report.evidence import ResidualMap
from vispeg.report.record import Record
from vispeg.report.text.quantities import fold, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Where the residual arises"
LABELS = {
    "speed": "speed (share of the joint's peak)",
    "load": "load (share of the joint's peak)",
    "position": "position (rad)",
    "phase": "phase (0: lower, 0.5: upper turning point)",
    "time": "time (s)",
    "frequency": "frequency (Hz)",
}
SHADES = ("#fff6da", "#fbdba4", "#f0a24f", "#d9541e", "#93260f", "#3f0d08")  # no grey, which means no data
NO_DATA, BETWEEN = day("empty"), "#fefefe"  # the style sheet darkens both in dark mode


def context(record: Record) -> Mapping[str, object]:
    """Return one picture of all maps on a common scale, and one sentence per map."""
    maps = list(record.evidence.maps.values())
    return {
        "picture": maps_picture(maps, record.evidence.joints),
        "sentences": [sentence(m, record) for m in maps],
        "held_out": record.kind == "diagnosis",
    }


def sentence(residual: ResidualMap, record: Record) -> str:
    """Return a sentence on the worst cell before and after, in multiples of the noise."""
    joints = record.evidence.joints
    text = f"Over {residual.axis}: largest {_worst(residual.before, residual, joints)}"
    return (
        f"{text} before, {_worst(residual.after, residual, joints)} after."
        if residual.after is not None
        else f"{text}."
    )


def maps_picture(maps: list[ResidualMap], joints: tuple[str, ...]) -> str:
    """Draw heat maps of joints by bins, before on the left and after on the right, with logarithmic colours."""
    if not maps:
        return ""
    name = "Residual by joint and " + ", ".join(m.axis for m in maps)
    return chart(lambda shape: _figure(maps, joints, shape), "maps", name)


def _figure(maps: list[ResidualMap], joints: tuple[str, ...], shape: Shape) -> Figure:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap
    from matplotlib.patches import Patch

    both = any(m.after is not None for m in maps)
    finite = np.concatenate([a[np.isfinite(a)] for m in maps for a in (m.before, m.after) if a is not None])
    top = max(3.0, float(finite.max())) if finite.size else 3.0
    levels = scale_levels(top)
    colours = LinearSegmentedColormap.from_list("residual", SHADES, 256).with_extremes(bad=(0, 0, 0, 0))
    norm = BoundaryNorm(levels, colours.N, extend="min")
    figure = new_figure(1.1 + len(maps) * (0.75 + 0.17 * len(joints)), shape.width)
    grid = figure.subplots(len(maps), 2 if both else 1, squeeze=False, sharey=True)
    for row, residual in zip(grid, maps, strict=True):
        row[0].set_title(LABELS[residual.axis], color=MUTED)
        for ax, values, side in zip(row, (residual.before, residual.after), ("before", "after"), strict=False):
            if values is None:
                ax.set_axis_off()
            else:
                _map(ax, residual, values, joints, colours, norm, 2 if shape.narrow else 5)
                ax.set_xlabel(side if both else "", color=MEASURED)
    bar = figure.colorbar(
        ScalarMappable(norm, colours), ax=grid, location="top", aspect=8 * shape.width, pad=0.02, extend="neither"
    )
    bar.set_label("RMS residual, in multiples of the noise")
    # labels at 1, 2 and 5 of each decade (on a narrow page at 1): first digit and first decimal of 1.0e+00
    named = [v for v in levels if f"{v:e}"[0] in ("1" if shape.narrow else "125") and f"{v:e}"[2] == "0"]
    bar.set_ticks(named, labels=[f"{v:g}" for v in named])
    bar.ax.tick_params(length=0, which="both")
    bar.outline.set_visible(False)
    if any(not np.isfinite(a).all() for m in maps for a in (m.before, m.after) if a is not None):
        figure.legend([Patch(facecolor=NO_DATA)], ["no data"], loc="outside lower right", handlelength=1.2)
    return figure


def scale_levels(top: float) -> np.ndarray:
    """Return colour steps from 1 to at least `top`: 1, 1.5, 2, 3, 5, 7, 10, 15 and so on."""
    decades = int(np.ceil(np.log10(top))) + 1
    steps = np.concatenate([np.array([1.0, 1.5, 2.0, 3.0, 5.0, 7.0]) * 10.0**d for d in range(decades)])
    return steps[: int(np.searchsorted(steps, top)) + 1]


def _map(
    ax: Any, residual: ResidualMap, values: np.ndarray, joints: tuple[str, ...], colours: Any, norm: Any, parts: int
) -> None:
    k = values.shape[1]
    masked = np.ma.masked_invalid(values)
    ax.pcolormesh(np.arange(k + 1), np.arange(len(joints) + 1), masked, cmap=colours, norm=norm, ec=BETWEEN, lw=0.6)
    ax.axhspan(0, len(joints), color=NO_DATA, lw=0, zorder=0)  # because the patch of the axes is not drawn
    ax.set_ylim(len(joints), 0)
    ax.set_yticks(np.arange(len(joints)) + 0.5, joints)
    ticks = np.arange(0, k + 1, max(1, math.ceil(k / parts)))
    edges = rounded(residual.edges)
    ax.set_xticks(ticks, [plain(edges[i], 2) for i in ticks])
    ax.tick_params(length=0)
    for side in ax.spines.values():
        side.set_visible(False)


def rounded(edges: np.ndarray) -> np.ndarray:
    """Round the edges of bins to two digits of the narrowest bin, so that the middle of -1.8337 to 1.8333 is 0."""
    width = float(np.diff(edges).min(initial=np.inf))
    return np.round(edges, 1 - math.floor(math.log10(width))) if 0 < width < np.inf else edges


def _worst(values: np.ndarray, residual: ResidualMap, joints: tuple[str, ...]) -> str:
    if not np.isfinite(values).any():
        return "not known"
    j, i = np.unravel_index(int(np.nanargmax(values)), values.shape)
    low, high = (plain(edge, 2) for edge in rounded(residual.edges)[i : i + 2])
    label = LABELS[residual.axis] if residual.axis != "phase" else ""
    unit = label.partition("(")[2].rstrip(")").replace("share of the joint's", "of its")
    size = values[j, i]
    times = f"{size:.2f}" if size < 2 else fold(float(size))
    return f"{times} × the noise ({joints[j]}, {low} to {high}{' ' + unit if unit else ''})"
