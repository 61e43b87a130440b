"""The style of all figures, and their conversion to inline SVG with real text, by matplotlib without pyplot.

Each figure is drawn twice, for wide and for narrow windows, and the style sheet shows one of the two. Otherwise text
that is legible on a laptop would be 5 px high on a phone.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from io import BytesIO, StringIO
from typing import TYPE_CHECKING, Any, Literal

from vispeg.report.drawings.palette import day, themed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import XAxis, YAxis
    from matplotlib.figure import Figure

MEASURED, BEFORE, AFTER = day("ink"), day("before"), day("after")
MUTED, RULE, RIVALS = day("muted"), day("rule"), (day("rival"), day("other"))
GROUND = day("ground")
FONT = "system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif"


@dataclass(frozen=True)
class Shape:
    """A format of figures.

    Attributes:
        name: `wide` or `narrow`; also the class of the SVG, by which the style sheet shows one and hides the other.
        width: in.
        size: pt, of all text; the style sheet scales the figure so that it is 12 px high.
    """

    name: str
    width: float
    size: float

    @property
    def narrow(self) -> bool:
        """Return whether panels are placed below each other."""
        return self.name == "narrow"

    def grid(self, panels: int, most: int) -> tuple[int, int]:
        """Return (rows, columns) for a number of panels, with at most `most` columns in a wide window."""
        columns = max(1, min(panels, (most + 1) // 2 if self.narrow else most))
        return math.ceil(max(panels, 1) / columns), columns


WIDE, NARROW = Shape("wide", 8.4, 9.0), Shape("narrow", 3.6, 9.0)

STYLE: Mapping[str, object] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib; wider than the system fonts that replace it, so text fits
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # fixed, as no panel has ticks on top
    "axes.labelcolor": MUTED,
    "axes.edgecolor": RULE,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "text.color": MEASURED,
    "xtick.color": RULE,
    "ytick.color": RULE,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "lines.linewidth": 1.0,
    "lines.solid_joinstyle": "round",
    "legend.frameon": False,
    "path.simplify_threshold": 0.3,
    "svg.fonttype": "none",
    "svg.hashsalt": "vispeg",
    "text.parse_math": False,  # names come from users and may contain dollar signs
}
MARKS = ("|", "^", "o", "s")  # entries of a legend with these styles are markers, the others lines
POINTS_AN_INCH = 72.0  # in an SVG by matplotlib
LONG = 300  # characters of an SVG path: a longer one is a curve, a shorter one a marker, which needs more digits
SIZED = ("font.size", "axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize")


@contextmanager
def styled(shape: Shape = WIDE) -> Iterator[None]:
    """Apply the style of all figures within `with`, and suppress warnings about glyphs that only the browser has."""
    import matplotlib

    rc: Any = {**STYLE, **dict.fromkeys(SIZED, shape.size)}
    with matplotlib.rc_context(rc), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")
        warnings.filterwarnings("ignore", message="constrained_layout not applied")
        yield


def chart(draw: Callable[[Shape], Figure | None], name: str, description: str) -> str:
    """Return a figure as inline SVG for wide and for narrow windows; empty if `draw` returns None."""
    parts = []
    for shape in (WIDE, NARROW):
        with styled(shape):
            figure = draw(shape)
            if figure is None:
                return ""
            parts.append(
                svg(figure, f"{name}-{shape.name}", description).replace("<svg", f'<svg class="{shape.name}"', 1)
            )
    return "".join(parts)


def new_figure(height: float, width: float = WIDE.width) -> Figure:
    """Return an empty figure, sizes in inches; call inside `styled()`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    # A notebook shows figures made by pyplot; others it shows by this method.
    figure._repr_png_ = partial(_png, figure)  # type: ignore[attr-defined]  # no attribute of a Figure
    return figure


def _png(figure: Figure) -> bytes:
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=100)
    return stream.getvalue()


def svg(figure: Figure, name: str, description: str) -> str:
    """Return the figure as inline SVG that scales with the page and uses its colours; ids are prefixed by `name`."""
    _lay_out(figure)
    return saved(figure, name, description)


def saved(figure: Figure, name: str, description: str) -> str:
    """Return the figure as `svg` does, but leave the layout to Matplotlib."""
    from html import escape

    stream = StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.S)
    words = re.findall(r">([^<]*[^<\s][^<]*)(?=<)", text)  # set aside, as they may look like what is changed below
    text = re.sub(r">[^<]*[^<\s][^<]*(?=<)", ">\0", text)
    text = re.sub(r"""\s(?:xmlns(?::\w+)?|version)=["'][^"']*["']""", "", text)
    text = text.replace("xlink:href=", "href=")
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r'(url\(|href=")#', rf"\1#{name}-", text)
    text = re.sub(r"font-family: [^;\"]*(; )?", "", text)
    text = _lighter(re.sub(r"\n\s*", "\n", text))
    head = re.sub(r'\s(?:width|height)="[^"]*"', "", text[: text.index(">")])
    label = escape(description, quote=True)
    text = re.sub(r'\bfill="(#[0-9a-f]{6})"', r'style="fill: \1"', text)  # of a hatch
    body = re.sub(r'style="[^"]*"', lambda style: themed(style[0]), text[text.index(">") + 1 :])
    parts = body.split("\0")
    body = "".join(part + word for part, word in zip(parts, [*words, ""], strict=True))
    return f'{head} font-family="{FONT}" role="img" aria-label="{label}"><title>{label}</title>{body}'


def _lay_out(figure: Figure) -> None:
    """Compute the layout, which saves the second drawing that `savefig` needs for the same result."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            if _bare(axis):
                axis.set_visible(False)
    engine, dpi = figure.get_layout_engine(), figure.dpi
    if engine is not None:
        FigureCanvasSVG(figure)
        figure.dpi = POINTS_AN_INCH
        engine.execute(figure)
        figure.dpi = dpi
        figure.set_layout_engine(None)


def _bare(axis: XAxis | YAxis) -> bool:
    """Return whether an axis has nothing visible, as in a column of panels that share the lowest one's axis."""
    from matplotlib.ticker import NullLocator

    if axis.get_label_text() or not isinstance(axis.get_minor_locator(), NullLocator):
        return False
    shown = axis.get_tick_params()
    sides = ("bottom", "top", "left", "right")
    marks = shown.get("length") != 0 and any(shown.get(side) for side in sides)
    return not (marks or shown.get("gridOn") or any(shown.get(f"label{side}") for side in sides))


def _lighter(text: str) -> str:
    """Shrink an SVG: coordinates to 0.01 px, or 0.1 px in long paths, and no unreferenced ids."""
    # ids that something refers to; report.css inverts the colours of a QuadMesh in the dark by its id
    used = {*re.findall(r'(?:url\(|href=")#([^)"]+)', text), *re.findall(r'id="([^"]*QuadMesh[^"]*)"', text)}
    text = re.sub(r' id="([^"]*)"', lambda name: name[0] if name[1] in used else "", text)
    text = re.sub(r' transform="rotate\(-0 [^"]*"', "", text)
    text = re.sub(r'\b[xy]="-?[\d.]+"', lambda at: _rounded(at[0], 2), text)
    text = re.sub(r'\bd="[^"]*"', lambda path: _rounded(path[0], 1 if len(path[0]) > LONG else 2), text)
    text = re.sub(r'\bd="[^"]*"', lambda path: re.sub(r"\s*([MLQCZz\"])\s*", r"\1", path[0]), text)
    while (without := re.sub(r"<g/>\n?|<g>\n?</g>\n?", "", text)) != text:
        text = without
    return text


def _rounded(text: str, digits: int) -> str:
    return re.sub(r"-?\d+\.\d+", lambda x: f"{float(x[0]):.{digits}f}".rstrip("0").rstrip("."), text)


def legend(figure: Figure, entries: dict[str, tuple[str, str]]) -> None:
    """Add a legend above the figure: name -> (colour, line style or a marker of MARKS)."""
    from matplotlib.lines import Line2D

    draw: Any = Line2D  # style names come from a table
    lines = [
        Line2D([], [], color=colour, marker=style, linestyle="", markersize=6)
        if style in MARKS
        else draw([], [], color=colour, linestyle=style, linewidth=2)
        for colour, style in entries.values()
    ]
    figure.legend(lines, list(entries), loc="outside upper left", ncols=side_by_side(figure, entries), handlelength=1.4)


def side_by_side(figure: Figure, names: Iterable[str]) -> int:
    """Return the number of legend entries that fit side by side, at 0.085 inch per character plus the sample."""
    widths = [0.085 * len(name) + 0.45 for name in names]
    return int(max(1, min(len(widths), figure.get_figwidth() // max(widths, default=1.0))))


def quiet(ax: Axes, *, grid: Literal["both", "x", "y"] = "y") -> None:
    """Draw a light grid behind the data, and hide tick marks."""
    ax.grid(axis=grid, color=RULE, linewidth=0.5, alpha=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(length=0)
