"""Success as bars drawn with HTML, so that text stays selectable and nine policies are legible on a phone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vispeg.core.counts import count
from vispeg.report.drawings.palette import name_of
from vispeg.report.gap import words, worlds
from vispeg.report.gap.colours import Style, of_policies, ordered

SCRIPTS = ("gap/toggles.js",)


@dataclass(frozen=True)
class Bar:
    """A success rate with its 95 % interval, in per cent.

    Attributes:
        name: name of the policy.
        number: place of the policy in the order of the page.
        value, low, high: rate and ends of its interval, per cent.
        percent: the rate as text.
        text: rate, interval and number of episodes as text.
        colour: name of the colour.
        second: whether it is the second policy of its modality, drawn hatched.
        home: whether the policy was trained in this world.
    """

    name: str
    number: int
    value: float
    low: float
    high: float
    percent: str
    text: str
    colour: str
    second: bool
    home: bool = False


def bar(name: str, number: int, e: Mapping[str, Any], style: Style, home: bool = False) -> Bar:
    """Return the bar of an estimate `e` (value, low, high, n); `home` marks a policy in the world of its training."""
    value, low, high = (100 * float(e[k]) for k in ("value", "low", "high"))
    text = f"{name}: {words.rate(e)}, 95 % interval, {count(e['n'], 'episode')}"
    percent = f"{value:.0f}\N{NO-BREAK SPACE}%"
    return Bar(name, number, value, low, high, percent, text, name_of(style.colour), style.second, home)


def policies(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return (name, colour) of every policy, with policies of one modality side by side."""
    styles = of_policies(ordered(values["policies"]))
    return [(name, name_of(style.colour)) for name, style in styles.items()]


def context(values: Mapping[str, Any]) -> Mapping[str, object]:
    """Return the template's values: one panel per world, with one bar per policy."""
    order = ordered(values["policies"])
    styles = of_policies(order)
    rates = {(r["policy"], r["world"]): r["success"] for r in values["success"] if not r["control"]}
    panels = []
    for world in (w["name"] for w in values["worlds"]):
        shared = worlds.home_of_all(world, order)  # the caption says so, and no single bar is marked
        rows = [
            bar(p["name"], i, rates[p["name"], world], styles[p["name"]], not shared and world in (p["home"] or ()))
            for i, p in enumerate(order)
            if (p["name"], world) in rates
        ]
        panels.append({"name": world, "caption": worlds.caption(world, values), "rows": rows})
    return {"panels": panels, "policies": policies(values)}
