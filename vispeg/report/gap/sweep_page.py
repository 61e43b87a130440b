"""Curves of success against a parameter, with bands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vispeg.report.drawings.figures import MUTED, Shape, chart, legend, new_figure, quiet
from vispeg.report.gap import table_page, words
from vispeg.report.gap.colours import of_policies
from vispeg.report.gap.page import page
from vispeg.report.text import effect_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def render(values: Mapping[str, Any]) -> str:
    """Give the page of a `vispeg-sensitivity/1` record."""
    lines = [f"{_title(s)}, {c['policy']}: {c['words']}" for s in values["sweeps"] for c in s["curves"]]
    sections = [table_page.title("How far off may it be", lines)]
    for i, sweep in enumerate(values["sweeps"]):
        heads = (_axis(sweep), *(c["policy"] for c in sweep["curves"]))
        points = [p["value"] for p in sweep["curves"][0]["points"]]
        rows = [[f"{v:g}", *(_cell(c["points"][j]) for c in sweep["curves"])] for j, v in enumerate(points)]
        text = (
            "Lines: success on the same seeds at every value. Bands: 95 % intervals, each value by itself, not of the "
            "curve. Dashed: nothing changed."
        )
        note = "lower: below the success at the dashed value, after Holm's correction over all values of this page."
        picture = curves(sweep, f"sweep{i}")
        sections.append(table_page.table(_title(sweep), heads, rows, picture=picture, caption=text, note=note))
    return page("vispeg sensitivity", "sensitivity", [*sections, table_page.origin(values)])


def _title(sweep: Mapping[str, Any]) -> str:
    """`Contact friction: scale` of the label `contact_friction.scale`."""
    return f"{effect_words.title(sweep['effect'])}: {', '.join(sweep['params'])}"


def _axis(sweep: Mapping[str, Any]) -> str:
    """Give what is swept, as `--sweep` takes it, and its unit."""
    return sweep["label"] + (f", {sweep['unit']}" if sweep["unit"] not in ("", "1") else "")


def _cell(point: Mapping[str, Any]) -> str:
    lower = point.get("verdict") == "different" and point["cost"]["value"] > 0
    return words.rate(point["success"]) + (", lower" if lower else "")


def curves(sweep: Mapping[str, Any], name: str) -> str:
    """One line with its band a policy."""
    return chart(lambda shape: _figure(sweep, shape), name, f"Success against {sweep['label']}")


def _figure(sweep: Mapping[str, Any], shape: Shape) -> Figure:
    styles = of_policies([{"name": c["policy"], "modality": c["modality"]} for c in sweep["curves"]])
    figure = new_figure(2.8, shape.width)
    ax = figure.add_subplot()
    for curve in sweep["curves"]:
        x = [p["value"] for p in curve["points"]]
        low, mid, high = ([100 * p["success"][k] for p in curve["points"]] for k in ("low", "value", "high"))
        style = styles[curve["policy"]]
        ax.fill_between(x, low, high, color=style.colour, alpha=0.18, linewidth=0)
        ax.plot(x, mid, color=style.colour, linestyle=style.line, marker="o", markersize=4)
    ax.axvline(sweep["null"], color=MUTED, linestyle=(0, (4, 2)), linewidth=1)
    ax.set(ylim=(-2, 102), ylabel="success, %", xlabel=_axis(sweep))
    quiet(ax)
    legend(figure, {name: (s.colour, s.line) for name, s in styles.items()})
    return figure
