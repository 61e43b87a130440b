"""The page of `vispeg explain`: why trials fail, from replays in simulation, rules of thumb, and ranked causes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from vispeg.core.counts import count
from vispeg.report.drawings.figures import AFTER, BEFORE, NARROW, Shape, chart, legend, new_figure, quiet
from vispeg.report.gap import table_page, words
from vispeg.report.gap.page import page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vispeg.evaluation.senses import Strip


def render(values: Mapping[str, Any], strip: Strip | None = None) -> str:
    """Render the page of a `vispeg-explain/1` record, with pictures of one trial."""
    lines = [f"{values['policy']}: {values['words']}"]
    if values["next"]:
        lines += [values["next"]["why"], f"next: {values['next']['command']}"]
    if simulator_worth := values.get("worth"):  # in real trials; missing in records of earlier versions
        lines.append(simulator_worth["words"])
    lines += values["notes"]
    sections = [table_page.title("Why do these trials fail?", lines)]
    sections += _story(values, strip)
    heads = ("cause", "without", "with it", "change, points", "share of the loss", "Holm", "verdict")
    heads += ("points to it", "cure", "hours")
    rows = [
        [
            _effect(c),
            words.rate(c["without"]),
            words.rate(c["with_it"]),
            words.change(c["cost"]),
            words.rate(c["share"]),
            words.p_value(c["p_holm"]),
            c["verdict"],
            "; ".join(c.get("points_to_it") or ()) or "-",
            c.get("cure") or "-",
            words.hours(c.get("hours")),
        ]
        for c in values["causes"]
    ]
    note = "Success of the policy in simulation from the trials' starts, on the same draws without and with the effect."
    if rows:
        sections.append(table_page.table("Causes", heads, rows, note=note))
    sections += _bridge(values)
    if values["senses"]:
        heads = ("sense", "moves the action by", "between two draws", "more", "Holm", "points to")
        rows = [
            [
                s["sense"],
                f"{s['moved_mm']:.2f} mm",
                f"{s['among_mm']:.2f} mm",
                _more(s["more_mm"]),
                words.p_value(s["p_holm"]),
                s["points_to"] or "-",
            ]
            for s in values["senses"]
        ]
        note = (
            "The policy's actions on the observations of the trials, with one sense replaced by simulation: images "
            "from the same poses, or the arm readings or wrench of a replay. If the robot were one more draw of the "
            "randomized world, the action would move as far as between two draws."
        )
        sections.append(table_page.table("Which of the policy's inputs differ", heads, rows, note=note))
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
    note = "; ".join([kinds["words"], *(m["words"] for m in values["measures"])])
    sections.append(table_page.table("How they fail", heads, counts, note=note))
    rules = [
        [r["rule"], f"{r['value']:.3g} {r['unit']}", f"{r['limit']:g}", r["points_to"] if r["speaks"] else "-"]
        for r in values["rules"]
    ]
    if rules:
        note = "Rules of thumb of practitioners, not statistical tests. Joints and delay are compared before contact."
        sections.append(table_page.table("Rules", ("rule", "here", "from", "points to"), rules, note=note))
    rows = [[t["trial"], t["category"], words.rate(t["closed"]), words.rate(t["open"])] for t in values["trials"]]
    heads = ("trial", "ended by", "the policy from its start", "its actions from its start")
    sections.append(table_page.table("Trials", heads, rows))
    return page("vispeg explain", "explanation of trials", [*sections, table_page.origin(values)])


def _bridge(values: Mapping[str, Any]) -> list[table_page.Section]:
    """Return sections on the unexplained remainder, the conditions of the verdict, and next steps with their cost."""
    sections, bridge, remainder = [], values["bridge"], values["remainder"]
    if remainder:
        regimes = ", ".join(
            f"{100 * r['share']:.0f} % in {name} ({count(r['recordings'], 'recording')})"
            for name, r in remainder["regimes"].items()
        )
        rows = [["without", words.rate(remainder["without"])], ["with it", words.rate(remainder["with_it"])]]
        rows.append(["change, points", words.change(remainder["cost"])])
        rows += [[f"{j['joint']}, RMS", f"{j['rms']:.2g} {j['unit']}"] for j in remainder["joints"]]
        note = (
            f"{remainder['words']}. With it: in the same episodes the joints are also disturbed by the torque that "
            f"{count(len(remainder['recordings']), 'recording')} needed beyond the identified model's, below 8 Hz, "
            f"drawn at random in blocks of {remainder['block_s']:.2g} s (twice its correlation time). Power: {regimes}."
        )
        sections.append(table_page.table("Effect of the unexplained torque", ("", "success"), rows, note=note))
    rows = [[c["condition"], c["here"], words.met(c["met"])] for c in bridge["conditions"]]
    rows += [[f"sign: {s['sign']}", s["here"], "present" if s["speaks"] else "absent"] for s in bridge["signs"]]
    note = (
        f"{bridge['verdict']}: {bridge['words']}. The gap is called unbridgeable only if all conditions are met. Signs "
        "by which practitioners recognise such a gap are shown for comparison and do not count."
    )
    sections.append(table_page.table("Can it be bridged here?", ("condition", "here", ""), rows, note=note))
    rows = [
        [
            s["step"],
            words.signed(s["gain"]),
            words.hours(s["hours"]),
            s["hours_from"],
            "-" if s["an_hour"] is None else f"{100 * s['an_hour']:.3g}",
            s["command"] or "-",
        ]
        for s in values["steps"]
    ]
    heads = ("next step", "wins back at most, points", "hours", "made up of", "points per hour", "command")
    note = "Upper limits: the loss that paired replays attribute to each cause. Hours of human work are as stated."
    sections.append(table_page.table("What to do next", heads, rows, note=note))
    return sections


def _effect(cause: Mapping[str, Any]) -> str:
    numbers = ", ".join(f"{k} {v:.3g}" for k, v in cause["params"].items() if isinstance(v, (int, float)))
    return f"{cause['effect']}: {numbers}" if numbers else cause["effect"]


def _more(more: Mapping[str, Any]) -> str:
    if more["low"] is None:
        return "-"
    return f"{more['value']:+.2f} [{more['low']:.2f}, {more['high']:.2f}] mm"


def _story(values: Mapping[str, Any], strip: Strip | None) -> list[table_page.Section]:
    """Return a section on one trial: real and simulated images, and the policy's action on each."""
    moment = values["moment"]
    if moment is None:
        return []
    asked = [["robot", _offset(moment["robot_mm"])]]
    asked.append([f"simulation's {moment['sense']}", _offset(moment["simulated_mm"])])
    text, drawn = "", ""
    if strip is not None:
        text = "Above: the robot's camera; below: simulation at the same joint angles. The frame marks this step."
        drawn = chart(lambda shape: _strip(strip, shape), "strip", "Pictures of the robot and of simulation")
    head = f"Where it differs most in {moment['sense']}: {moment['trial']}, {moment['time_s']:.2f} s"
    return [
        table_page.table(head, ("on", "the policy asks for, mm in the base's axes"), asked, picture=drawn, caption=text)
    ]


def _offset(offset: Sequence[float]) -> str:
    return ", ".join(f"{x:+.1f}" for x in offset).replace("-", "\N{MINUS SIGN}")


def _strip(strip: Strip, shape: Shape) -> Figure:
    keys, shown = list(strip.robot), list(range(len(strip.steps)))
    if shape is NARROW:  # four steps around the moment
        first = max(0, min(strip.moment - 1, len(shown) - 4))
        shown = shown[first : first + 4]
    side = shape.width / len(shown)
    figure = new_figure(0.2 + (2 * side + 0.15) * len(keys), shape.width)
    grid = figure.subplots(2 * len(keys), len(shown), squeeze=False)
    for k, key in enumerate(keys):
        for row, (side_name, pictures) in enumerate((("robot", strip.robot), ("simulation", strip.simulated))):
            for column, i in enumerate(shown):
                axes = grid[2 * k + row][column]
                axes.imshow(pictures[key][i], interpolation="nearest")
                axes.set(xticks=[], yticks=[])
                for spine in axes.spines.values():
                    spine.set(visible=i == strip.moment, color=AFTER, linewidth=2)
                if column == 0:
                    axes.set_ylabel(f"{key}\n{side_name}", fontsize="small")
                if row == 0:
                    axes.set_title(f"step {strip.steps[i]}", loc="left")
    return figure


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
