"""Hard positions, still and pushed: an interval each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vispeg.report.drawings.figures import AFTER, BEFORE, MEASURED, Shape, chart, legend, new_figure, quiet
from vispeg.report.gap import table_page, words
from vispeg.report.gap.page import page

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def render(values: Mapping[str, Any]) -> str:
    """Give the page of a `vispeg-perturb/1` record."""
    policies = list(dict.fromkeys(r["policy"] for r in values["rows"]))
    lines, sections = [], []
    for i, policy in enumerate(policies):
        rows = [r for r in values["rows"] if r["policy"] == policy]
        lines.append(f"{policy}: {_weakest([r for r in rows if r['still']])}")
        cells = [[r["position"], _rate(r["still"]), _rate(r["pushed"]), _cost(r), r["verdict"] or "-"] for r in rows]
        heads = ("position", "still", "pushed", "change by the push, points", "verdict")
        sections.append(table_page.table(policy, heads, cells, picture=picture(rows, f"positions{i}")))
    low, high = values["force"]
    text = f"Pushes of {low:g} to {high:g} N for {values['duration']:g} s, from any side, once an episode"
    sections.append(table_page.table("When a difference is one", (), (), note=values["rule"]))
    return page(
        "vispeg perturb", "perturbations", [table_page.title(text, lines), *sections, table_page.origin(values)]
    )


def _weakest(rows: list[Any]) -> str:
    """Where fewest succeed that are not pushed, all such positions; no place where they are all alike."""
    worst = min(rows, key=lambda r: r["still"]["value"])["still"]
    there = [r["position"] for r in rows if r["still"]["value"] == worst["value"]]
    if len(there) == len(rows) > 1:
        return f"{words.rate(worst)} still, in every position"
    return f"weakest {', '.join(there)}: {words.rate(worst)} still"


def _rate(e: Mapping[str, Any] | None) -> str:
    return "-" if e is None else words.rate(e)


def _cost(r: Mapping[str, Any]) -> str:
    return "-" if r["cost"] is None else words.change(r["cost"])


def picture(rows: list[Any], name: str) -> str:
    """Give a dot with its interval a position and side."""
    return chart(lambda shape: _figure(rows, shape), name, "Success by position, still and pushed")


def _figure(rows: list[Any], shape: Shape) -> Figure:
    figure = new_figure(0.8 + 0.32 * len(rows), shape.width)
    ax = figure.add_subplot()
    for i, r in enumerate(rows):
        for kind, colour, shift in (("still", AFTER, -0.13), ("pushed", BEFORE, 0.13)):
            e = r[kind]
            if e is not None:
                ax.plot([100 * e["low"], 100 * e["high"]], [i + shift] * 2, color=colour, linewidth=2, alpha=0.6)
                ax.plot(100 * e["value"], i + shift, "o", color=colour, markersize=5)
    ax.set(xlim=(-2, 102), ylim=(len(rows) - 0.5, -0.5), xlabel="success, %")
    ax.set_yticks(range(len(rows)), [r["position"] for r in rows])
    ax.tick_params(axis="y", labelcolor=MEASURED)
    quiet(ax, grid="x")
    legend(figure, {"still": (AFTER, "-"), "pushed": (BEFORE, "-")})
    return figure
