"""The pages of the stress tests: success over a parameter, with fixed contacts, at hard positions and under pushes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from vispeg.report.drawings.figures import AFTER, BEFORE, MEASURED, MUTED, Shape, chart, legend, new_figure, quiet
from vispeg.report.gap import table_page, words
from vispeg.report.gap.colours import of_policies
from vispeg.report.gap.page import page
from vispeg.report.text import effect_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEP = 0.16  # s between two actions of the policy, in records from before they stated it


def sensitivity_page(values: Mapping[str, Any]) -> str:
    """Return the page of a `vispeg-sensitivity/1` record."""
    lines = [f"{_title(s)}, {c['policy']}: {c['words']}" for s in values["sweeps"] for c in s["curves"]]
    sections = [table_page.title("How far off may a parameter be", lines)]
    for i, sweep in enumerate(values["sweeps"]):
        heads = (_axis(sweep), *(c["policy"] for c in sweep["curves"]))
        points = [p["value"] for p in sweep["curves"][0]["points"]]
        rows = [[f"{v:g}", *(_cell(c["points"][j]) for c in sweep["curves"])] for j, v in enumerate(points)]
        text = (
            "Lines: success on the same seeds at every value. Bands: 95 % intervals of single values, not of the whole "
            "curve. Dashed: the value without the effect."
        )
        note = "lower: below the success at the dashed value, after Holm's correction over all values of this page."
        picture = curves(sweep, f"sweep{i}")
        sections.append(table_page.table(_title(sweep), heads, rows, picture=picture, caption=text, note=note))
    return page("vispeg sensitivity", "sensitivity", [*sections, table_page.origin(values)])


def _title(sweep: Mapping[str, Any]) -> str:
    """Return the title of a sweep, such as `Contact friction: scale` for `contact_friction.scale`."""
    return f"{effect_words.title(sweep['effect'])}: {', '.join(sweep['params'])}"


def _axis(sweep: Mapping[str, Any]) -> str:
    """Return the swept parameter, in the form of `--sweep`, and its unit."""
    return sweep["label"] + (f", {sweep['unit']}" if sweep["unit"] not in ("", "1") else "")


def _cell(point: Mapping[str, Any]) -> str:
    lower = point.get("verdict") == "different" and point["cost"]["value"] > 0
    return words.rate(point["success"]) + (", lower" if lower else "")


def curves(sweep: Mapping[str, Any], name: str) -> str:
    """Draw success over the parameter, one line with its 95 % band per policy."""
    return chart(lambda shape: _curves(sweep, shape), name, f"Success against {sweep['label']}")


def _curves(sweep: Mapping[str, Any], shape: Shape) -> Figure:
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


def exploit_page(values: Mapping[str, Any]) -> str:
    """Return the page of a `vispeg-exploit/1` record."""
    lines = [f"{r['policy']}: {r['words']}" for r in values["policies"]]
    heads = ("policy", "fixed", "randomized", "change, points", "Holm", "median peak force", "Holm", "verdict")
    rows = []
    for r in values["policies"]:
        peak = r["peak"]
        sizes = peak["fixed"], peak["randomized"]
        force = "-" if None in sizes else "{:.0f} and {:.0f} N".format(*sizes)
        sides = [words.rate(r[k]) for k in ("fixed", "randomized")]
        tests = [words.change(r["cost"]), words.p_value(r["p_holm"]), force, words.p_value(peak["p_holm"])]
        rows.append([r["policy"], *sides, *tests, r["verdict"]])
    note = (
        f"Equal: the interval lies within {100 * values['margin']:.0f} points. Holm: after "
        "the correction over all tests of this page: exact tests of success, Mann-Whitney's of peak forces."
    )
    sections = [table_page.title("Does success depend on the contact solver?", lines)]
    sections.append(table_page.table("Success", heads, rows, note=note))
    text = "Contact force since first contact: median and quartiles over the episodes that got there."
    picture = profiles(values)
    steps = [
        [r["policy"], k, f"{s['successes']} of {s['n']}"] for r in values["policies"] for k, s in r["substeps"].items()
    ]
    heads = ("policy", "physics steps per control period", "success")
    sections.append(table_page.table("Force", heads, steps, picture=picture, caption=text))
    return page("vispeg exploit", "exploitation test", [*sections, table_page.origin(values)])


def profiles(values: Mapping[str, Any]) -> str:
    """Draw the contact force over time since first contact, fixed and randomized, one panel per policy."""
    text = "Contact force since first contact, fixed and randomized"
    return chart(lambda shape: _profiles(values["policies"], shape), "profiles", text)


def _profiles(policies: Sequence[Mapping[str, Any]], shape: Shape) -> Figure:
    lines, columns = shape.grid(len(policies), 2 if len(policies) < 3 else 3)
    figure = new_figure(2.3 * lines + 0.4, shape.width)
    axes = figure.subplots(lines, columns if shape.narrow else max(2, columns), squeeze=False, sharey=True)
    for ax in axes.flat[len(policies) :]:
        ax.set_visible(False)
    for ax, row in zip(axes.flat, policies, strict=False):
        period = row.get("policy_period") or STEP
        for kind, colour in (("fixed", AFTER), ("randomized", BEFORE)):
            p = row["profiles"][kind]
            t = [period * i for i in range(len(p["median"]))]
            ax.fill_between(t, p["low"], p["high"], color=colour, alpha=0.2, linewidth=0)
            ax.plot(t, p["median"], color=colour)
        ax.set(title=row["policy"], xlabel="time since contact, s")
        quiet(ax)
    for ax in axes[:, 0]:
        ax.set_ylabel("contact force, N")
    axes[0, 0].set_ylim(bottom=0)
    legend(figure, {"fixed": (AFTER, "-"), "randomized": (BEFORE, "-")})
    return figure


def perturb_page(values: Mapping[str, Any]) -> str:
    """Return the page of a `vispeg-perturb/1` record."""
    policies = list(dict.fromkeys(r["policy"] for r in values["rows"]))
    lines, sections = [], []
    for i, policy in enumerate(policies):
        rows = [r for r in values["rows"] if r["policy"] == policy]
        lines.append(f"{policy}: {_weakest([r for r in rows if r['still']])}")
        cells = [
            [r["position"], words.rate(r["still"]), words.rate(r["pushed"]), _cost(r), r["verdict"] or "-"]
            for r in rows
        ]
        heads = ("position", "still", "pushed", "change by the push, points", "verdict")
        sections.append(table_page.table(policy, heads, cells, picture=positions(rows, f"positions{i}")))
    low, high = values["force"]
    text = f"Pushes of {low:g} to {high:g} N for {values['duration']:g} s, from any side, once an episode"
    sections.append(table_page.table("When a difference counts", (), (), note=values["rule"]))
    return page(
        "vispeg perturb", "perturbations", [table_page.title(text, lines), *sections, table_page.origin(values)]
    )


def _weakest(rows: list[Any]) -> str:
    """Return in words the positions with the lowest success without pushes; no position is named if all are equal."""
    worst = min(rows, key=lambda r: r["still"]["value"])["still"]
    weakest = [r["position"] for r in rows if r["still"]["value"] == worst["value"]]
    if len(weakest) == len(rows) > 1:
        return f"{words.rate(worst)} still, in every position"
    return f"weakest {', '.join(weakest)}: {words.rate(worst)} still"


def _cost(r: Mapping[str, Any]) -> str:
    return "-" if r["cost"] is None else words.change(r["cost"])


def positions(rows: list[Any], name: str) -> str:
    """Draw success with its interval at each position, still and pushed."""
    return chart(lambda shape: _positions(rows, shape), name, "Success by position, still and pushed")


def _positions(rows: list[Any], shape: Shape) -> Figure:
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
