"""The page of the regression suite: success in the training world against the target, by configuration and version."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from vispeg.evaluation.suite import ALARM, HEALTHY
from vispeg.report.drawings.figures import AFTER, BEFORE, MEASURED, MUTED, RULE, Shape, chart, new_figure, quiet
from vispeg.report.gap import table_page, words
from vispeg.report.gap.page import page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def render(
    versions: Sequence[Mapping[str, Any]], changes: Sequence[Mapping[str, Any]], notes: Sequence[str] = ()
) -> str:
    """Render the page of `vispeg-suite-result/1` records, oldest first, with the changes between the last two."""
    last = versions[-1]
    lines = [f"{v['version']}: {v['health']['words']}" for v in versions]
    changed = [c for c in changes if c["verdict"] in ("fell", "rose")]
    lines += [
        f"{c['configuration']} in {c['world']} {c['verdict']}: {words.signed(c['change'])} points" for c in changed
    ]
    lines += [*(last.get("notes") or ()), *notes]
    sections = [table_page.title(f"Regression suite, {last['version']}", lines)]
    heads = ("policy", "configuration", last["train"], last["target"])
    rows = [[r["policy"], r["configuration"], words.rate(r["train"]), words.rate(r["target"])] for r in last["rows"]]
    caption = "One point per configuration. On the line, success in the target equals success in the training world."
    if len(versions) > 1:
        caption += (
            f" Right: correlation of the two by version; above {HEALTHY} is healthy, below {ALARM} raises an alarm."
        )
    picture = scatter(versions)
    sections.append(table_page.table("Configurations", heads, rows, picture=picture, caption=caption))
    if changes:
        heads = ("policy", "world", "configuration", "change, points", "Holm", "verdict")
        cells = [
            [
                c["policy"],
                c["world"],
                c["configuration"],
                words.signed(c["change"]),
                words.p_value(c["p_holm"]),
                c["verdict"],
            ]
            for c in changes
        ]
        sections.append(table_page.table(f"{versions[-2]['version']} to {last['version']}", heads, cells))
    worlds = [w for w in last.get("worlds") or () if w["name"] in (last["train"], last["target"])]
    return page("vispeg suite", "regression suite", [*sections, table_page.origin({**last, "worlds": worlds})])


def scatter(versions: Sequence[Mapping[str, Any]]) -> str:
    """Draw success in the target against the training world, and with several versions their correlation by version."""
    text = "Training world against target by configuration"
    return chart(lambda shape: _figure(versions, shape), "suite", text)


def _figure(versions: Sequence[Mapping[str, Any]], shape: Shape) -> Figure:
    several = len(versions) > 1
    figure = new_figure(2.9 * (1 + (several and shape.narrow)), shape.width)
    if shape.narrow:
        axes = figure.subplots(1 + several, 1, squeeze=False)[:, 0]
    else:
        axes = figure.subplots(1, 2, width_ratios=(1, 1.4))
    _points(axes[0], versions[-1])
    if several:
        _history(axes[1], versions)
    elif len(axes) > 1:
        axes[1].set_visible(False)
    return figure


def _points(ax: Axes, last: Mapping[str, Any]) -> None:
    ax.plot([0, 100], [0, 100], color=RULE)
    for r in last["rows"]:
        x, y = 100 * r["train"]["value"], 100 * r["target"]["value"]
        ax.plot([x, x], [100 * r["target"]["low"], 100 * r["target"]["high"]], color=AFTER, alpha=0.3, linewidth=1.5)
        ax.plot(x, y, "o", color=AFTER, markersize=5, alpha=0.85)
    ax.set(xlim=(-4, 104), ylim=(-4, 104), xlabel=f"{last['train']}, %", ylabel=f"{last['target']}, %", aspect="equal")
    quiet(ax, grid="both")


def _history(ax: Axes, versions: Sequence[Mapping[str, Any]]) -> None:
    ax.axhspan(HEALTHY, 1.02, color=AFTER, alpha=0.08, linewidth=0)
    ax.axhspan(-1.02, ALARM, color=BEFORE, alpha=0.08, linewidth=0)
    for i, v in enumerate(versions):
        e = v["health"].get("pearson")
        if e is not None and e["value"] is not None:
            ax.plot([i, i], [e["low"], e["high"]], color=MEASURED, linewidth=1.3)
            ax.plot(i, e["value"], "o", color=MEASURED, markersize=5)
    ax.set_xticks(range(len(versions)), [v["version"] for v in versions])
    ax.set(ylim=(-1.02, 1.02), ylabel="correlation")
    ax.tick_params(axis="x", labelcolor=MUTED)
    quiet(ax)
