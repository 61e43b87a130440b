"""The look of every figure, and its way into the page: matplotlib without pyplot, inline SVG with real text."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED, BEFORE, AFTER = "#16181d", "#d9541e", "#0a7a75"
MUTED, RULE, RIVALS = "#6b7280", "#d7dbe0", ("#5b4bb7", "#b0892b")
WIDTH = 8.4  # inch; at this width 8.5 pt text is easy to read on a laptop and on A4
FONT = "system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif"

STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib; wider than the system fonts that replace it, so all fits
    "font.size": 8.5,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.labelcolor": MUTED,
    "axes.edgecolor": RULE,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "xtick.color": RULE,
    "ytick.color": RULE,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "lines.linewidth": 1.0,
    "lines.solid_joinstyle": "round",
    "legend.frameon": False,
    "path.simplify_threshold": 0.3,
    "svg.fonttype": "none",
    "svg.hashsalt": "vispeg",
    "text.parse_math": False,  # names are the user's: a dollar sign is a dollar sign
}


@contextmanager
def styled() -> Iterator[None]:
    """Matplotlib as every figure here wants it, and no word about glyphs that only the browser has."""
    import matplotlib

    rc: Any = STYLE
    with matplotlib.rc_context(rc), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")
        warnings.filterwarnings("ignore", message="constrained_layout not applied")
        yield


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure, sizes in inch; call inside `styled()`."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def svg(figure: Figure, name: str, description: str) -> str:
    """The figure as inline SVG: scales with the page, refers to nothing outside it, ids prefixed by `name`."""
    from html import escape

    stream = StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.S)
    text = re.sub(r"""\s(?:xmlns(?::\w+)?|version)=["'][^"']*["']""", "", text)
    text = text.replace("xlink:href=", "href=")
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r'(url\(|href=")#', rf"\1#{name}-", text)
    text = re.sub(r"font-family: [^;\"]*", f"font-family: {FONT}", text)
    text = re.sub(r"\n\s*", "\n", text)
    head = re.sub(r'\s(?:width|height)="[^"]*"', "", text[: text.index(">")])
    label = escape(description, quote=True)
    return f'{head} role="img" aria-label="{label}"><title>{label}</title>{text[text.index(">") + 1 :]}'


def thin(time: np.ndarray, values: np.ndarray, most: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """At most `most` points of (n,) arrays that keep the lowest and highest value of every stretch, and gaps as NaN."""
    n = len(time)
    if n <= most:
        return time, values
    keep = []
    for part in np.array_split(np.arange(n), max(1, most // 2)):
        finite = part[np.isfinite(values[part])]
        keep += [finite[np.argmin(values[finite])], finite[np.argmax(values[finite])]] if finite.size else [part[0]]
    index = np.unique(keep)
    return time[index], values[index]


def legend(figure: Figure, entries: dict[str, tuple[str, str]]) -> None:
    """Lines of five above the figure: name -> (colour, line style or the marker "|")."""
    from matplotlib.lines import Line2D

    draw: Any = Line2D  # style names come from a table
    lines = [
        Line2D([], [], color=colour, marker="|", linestyle="", markersize=9, markeredgewidth=1.6)
        if style == "|"
        else draw([], [], color=colour, linestyle=style, linewidth=2)
        for colour, style in entries.values()
    ]
    figure.legend(lines, list(entries), loc="outside upper left", ncols=min(len(entries), 5), handlelength=1.4)


def quiet(ax: Axes, *, grid: str = "y") -> None:
    """Light grid behind the data, few ticks."""
    if grid:
        ax.grid(axis=grid, color=RULE, linewidth=0.5, alpha=0.7)  # type: ignore[arg-type]
    ax.set_axisbelow(True)
    ax.tick_params(length=0)
