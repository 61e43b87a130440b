"""Rates and differences as text: per cent for success, percentage points for differences, with intervals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.core.counts import count
from vispeg.evaluation.controls import FIXED
from vispeg.report.text.quantities import plain

Row = Mapping[str, Any]
CONTROLS = {  # name of a control in gap.json ("" for none) -> text
    "": "",
    "shuffled": "images of another episode",
    "frozen": "first image for ever",
}
# Modality of a policy without cameras, or `scripted` -> its role; "" stands for policies with cameras. In the order in
# which the page lists them.
ROLES = {
    "": "",
    "scripted": "scripted, told the goal",
    "state": "teacher, told the goal",
    "privileged": "teacher, told goal and physics",
    "proprio": "blind",
}


def percent(value: float | None) -> str:
    """Return a share in per cent, `99.4 %` for 0.994; whole numbers have no decimal, zero has no sign."""
    if value is None:
        return "-"
    text = f"{round(100 * value, 1) + 0.0:.1f}"  # + 0.0: no negative zero
    return text.removesuffix(".0").replace("-", "\N{MINUS SIGN}") + " %"


def rate(e: Row | None) -> str:
    """Return a rate, or a share (which may be below 0 % or above 100 %), with its interval: `87 % (81 to 92)`."""
    return "-" if e is None else percent(e["value"]) + _interval(e)


def rate_of(e: Row) -> str:
    """Return a success rate with its interval and sample: `87 % (81 to 92) of 60 episodes`."""
    return f"{rate(e)} of {count(e['n'], 'episode')}"


def points(value: float | None) -> str:
    """Return a difference in percentage points with its sign: `−12` for -0.123."""
    return "-" if value is None else hundredths(value, "+")


def hundredths(value: float, sign: str = "") -> str:
    """Return 100 times a value, rounded, with a typographic minus and no negative zero: `−12` for -0.123."""
    number = round(100 * value)
    return f"{number:{sign if number else ''}d}".replace("-", "\N{MINUS SIGN}")


def signed(e: Row) -> str:
    """Return a difference of success with its interval, if it has one, in percentage points: `+12 (7 to 18)`."""
    return points(e["value"]) + _interval(e)


def _interval(e: Row) -> str:
    """Return an interval behind its estimate, in hundredths; empty if an end or the estimate is missing."""
    if None in (e["value"], e["low"], e["high"]):
        return ""
    return f" ({hundredths(e['low'])} to {hundredths(e['high'])})"


def change(e: Row) -> str:
    """Return a gap or cost, which is lost success, as a change of success: `−12 (−18 to −7)`."""
    return signed(
        {
            k: None if e[of] is None else -e[of]
            for k, of in zip(("value", "low", "high"), ("value", "high", "low"), strict=True)
        }
    )


def p_value(p: float | None) -> str:
    """Return a p-value as text: `0.031` for 0.0312, `< 0.001` for smaller ones."""
    if p is None:
        return "-"
    return "< 0.001" if p < 0.001 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


def role(policy: Row) -> str:
    """Return a policy's role, such as `teacher, told the goal` or `blind`; empty for policies with cameras."""
    return ROLES.get("scripted" if policy.get("scripted") else str(policy["modality"]), "")


def conclusion(row: Row) -> str:
    """Return a row of `success` in words, and the number of episodes that determine it to 5 points, if known."""
    more = f"; to tell it within 5 points takes up to {row['needed']} episodes" if row.get("needed") else ""
    return f"{name(row)}: {row['words']}{more}"


def name(row: Row) -> str:
    """Return a row's policy and control: `depth`, or `depth, first image for ever`."""
    kind = row.get("control", "")
    return f"{row['policy']}, {control(kind)}" if kind else str(row["policy"])


def control(kind: str) -> str:
    """Return a control in words, such as `first image for ever` or `goal at its nominal place`."""
    if kind.endswith(FIXED):
        return f"{kind.removesuffix(FIXED)} at its nominal place"
    return CONTROLS.get(kind, kind)


def met(condition: bool | None) -> str:
    """Return `met`, `not met`, or `not known`."""
    return "not known" if condition is None else "met" if condition else "not met"


def hours(value: float | None) -> str:
    """Return hours with two digits or more; `not known` for None."""
    return "not known" if value is None else f"{plain(value, 2)} h"
