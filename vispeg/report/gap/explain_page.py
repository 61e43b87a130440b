"""Why trials fail: where their starts lead in simulation, rules, and causes by what they explain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from vispeg.report.drawings.figures import AFTER, BEFORE, Shape, chart, legend, new_figure, quiet
from vispeg.report.gap import table_page, words
from vispeg.report.gap.page import page

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def render(values: Mapping[str, Any]) -> str:
    """The page of a `vispeg-explain/1` record."""
    lines = [f"{values['policy']}: {values['words']}", *values["notes"]]
    sections = [table_page.title("Why do these trials fail?", lines)]
    heads = ("cause", "without", "with it", "change, points", "share of the loss", "Holm", "verdict")
    rows = [
        [
            _effect(c),
            words.rate(c["without"]),
            words.rate(c["with_it"]),
            words.change(c["cost"]),
            words.share(c["share"]),
            words.p_value(c["p_holm"]),
            c["verdict"],
        ]
        for c in values["causes"]
    ]
    note = "Success of the policy in simulation from the trials' starts, on the same draws without and with the effect."
    if rows:
        sections.append(table_page.table("Causes", heads, rows, note=note))
    rates = [("robot", values["robot"]), ("simulation, the policy", values["closed"])]
    rates.append(("simulation, the trials' actions", values["open"]))
    if values["failed"] is not None:
        rates.append(("simulation, from the starts of failures", values["failed"]))
    success = [[name, words.rate_of(e).replace("episodes", "trials")] for name, e in rates]
    text = "Share of the replays from each trial's start that succeed, 95 % intervals; filled: the trial succeeded."
    drawn = chart(lambda shape: _figure(values["trials"], shape), "starts", "Success from each trial's start")
    head = f"The same starts in simulation; replays of each: {values['replays']}"
    sections.append(table_page.table(head, ("where", "success"), success, picture=drawn, caption=text))
    kinds = values["categories"]
    counts = [
        [k["category"], words.percent(k["first"]), words.percent(k["second"]), words.p_value(k["p_holm"]), k["verdict"]]
        for k in kinds["kinds"]
    ]
    heads = ("kind of end", "simulation", "robot", "Holm", "verdict")
    said = "; ".join([kinds["words"], *(m["words"] for m in values["measures"])])
    sections.append(table_page.table("How they fail", heads, counts, note=said))
    rules = [
        [r["rule"], f"{r['value']:.3g} {r['unit']}", f"{r['limit']:g}", r["points_to"] if r["speaks"] else "-"]
        for r in values["rules"]
    ]
    if rules:
        note = "Rules of thumb of the article, no tests. Joints and delay are compared before contact."
        sections.append(table_page.table("Rules", ("rule", "here", "from", "points to"), rules, note=note))
    each = [[t["trial"], t["category"], words.rate(t["closed"]), words.rate(t["open"])] for t in values["trials"]]
    heads = ("trial", "ended by", "the policy from its start", "its actions from its start")
    sections.append(table_page.table("Trials", heads, each))
    return page("vispeg explain", "explanation of trials", [*sections, table_page.origin(values)])


def _effect(cause: Mapping[str, Any]) -> str:
    numbers = ", ".join(f"{k} {v:.3g}" for k, v in cause["params"].items() if isinstance(v, (int, float)))
    return f"{cause['effect']}: {numbers}" if numbers else cause["effect"]


def _figure(trials: Sequence[Mapping[str, Any]], shape: Shape) -> Figure:
    figure = new_figure(0.9 + 0.22 * len(trials), shape.width)
    axes = figure.add_subplot()
    for y, trial in enumerate(trials):
        for key, colour, off in (("closed", AFTER, -0.15), ("open", BEFORE, 0.15)):
            e = trial[key]
            axes.plot([100 * e["low"], 100 * e["high"]], [y + off] * 2, color=colour, linewidth=1.5)
            face = colour if trial["success"] else "white"
            axes.plot(100 * e["value"], y + off, "o", color=colour, markerfacecolor=face, markersize=4)
    axes.set_yticks(range(len(trials)), [t["trial"].rpartition("-")[2] or t["trial"] for t in trials])
    axes.set(xlim=(-2, 102), ylim=(len(trials) - 0.4, -0.6), xlabel="success, % of replays", ylabel="trial")
    quiet(axes, grid="x")
    legend(figure, {"policy": (AFTER, "-"), "the trial's actions": (BEFORE, "-")})
    return figure
