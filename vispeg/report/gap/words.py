"""Rates and differences as text: per cent for success, points for differences, always with their interval."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.evaluation.controls import FIXED

Row = Mapping[str, Any]
CONTROLS = {
    "": "",
    "shuffled": "images of another episode",
    "frozen": "first image for ever",
}
ROLES = {  # of modalities that do not look for the goal, and of the policy that was never trained
    "": "",
    "scripted": "scripted, told the goal",
    "state": "teacher, told the goal",
    "privileged": "teacher, told goal and physics",
    "proprio": "blind",
}


def percent(value: float | None) -> str:
    """0.994 -> 99.4 %; whole numbers without a decimal."""
    if value is None:
        return "-"
    text = f"{100 * value:.1f}"
    return text.removesuffix(".0") + " %"


def rate(e: Row) -> str:
    """`87 % (81 to 92)`."""
    return f"{percent(e['value'])} ({100 * e['low']:.0f} to {100 * e['high']:.0f})"


def share(e: Row | None) -> str:
    """Give a share of a loss, which may be below 0 or above all of it: `15 % (−12 to 75)`."""
    return "-" if e is None else f"{percent(e['value'])} ({hundredths(e['low'])} to {hundredths(e['high'])})"


def rate_of(e: Row) -> str:
    """`87 % (81 to 92) of 60 episodes`."""
    return f"{rate(e)} of {e['n']} episodes"


def points(value: float | None) -> str:
    """-0.123 -> -12 points, with a sign."""
    return "-" if value is None else hundredths(value, "+")


def hundredths(value: float, sign: str = "") -> str:
    """-0.123 -> -12 with a typographer's minus; never a negative zero."""
    number = round(100 * value)
    return f"{number:{sign if number else ''}d}".replace("-", "\N{MINUS SIGN}")


def signed(e: Row) -> str:
    """Give a difference with its interval in points of success: `+12 (7 to 18)`."""
    if e["value"] is None or e["low"] is None:
        return points(e["value"])
    return f"{points(e['value'])} ({hundredths(e['low'])} to {hundredths(e['high'])})"


def change(e: Row) -> str:
    """Give a gap or a cost, which is success lost, as the change of success: `-12 (-18 to -7)`."""
    return signed(
        {
            k: None if e[of] is None else -e[of]
            for k, of in zip(("value", "low", "high"), ("value", "high", "low"), strict=True)
        }
    )


def p_value(p: float | None) -> str:
    """0.0312 -> 0.031; small ones as < 0.001."""
    if p is None:
        return "-"
    return "< 0.001" if p < 0.001 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


def role(policy: Row) -> str:
    """Give the role of a policy beside those with cameras: `teacher, told the goal`, `blind`, or nothing."""
    return ROLES.get("scripted" if policy.get("scripted") else str(policy["modality"]), "")


def conclusion(row: Row) -> str:
    """Return what the episodes of a row of `success` can resolve, and how many more would be needed."""
    more = f"; to tell it within 5 points takes up to {row['needed']} episodes" if row.get("needed") else ""
    return f"{name(row)}: {row['words']}{more}"


def name(row: Row) -> str:
    """`depth`, or `depth, first image for ever` under a control."""
    kind = row.get("control", "")
    return f"{row['policy']}, {control(kind)}" if kind else str(row["policy"])


def control(kind: str) -> str:
    """`first image for ever`; of one that keeps the goal in place, `goal at its nominal place`."""
    if kind.endswith(FIXED):
        return f"{kind.removesuffix(FIXED)} at its nominal place"
    return CONTROLS.get(kind, kind)


def met(condition: bool | None) -> str:
    """`met`, `not met`, or `not known`."""
    return "not known" if condition is None else "met" if condition else "not met"


def hours(value: float | None) -> str:
    """Give hours to two digits; `not known` where there are none."""
    return "not known" if value is None else f"{value:.2g} h"
