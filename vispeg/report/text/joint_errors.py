"""The residual of each joint's readings compared with their noise floor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.record import rows
from vispeg.report.text.quantities import fold, number, quantity

READINGS = {"angle": "angle", "servo": "angle", "torque": "torque", "needed": "torque", "load": "load"}
FAR = 3.0  # in noise floors; a joint above this is named even if all joints together are at the noise floor


def table(values: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return rows for each joint and kind of reading: held-out error before and after, noise floor, and the ratio.

    `least` is the residual of a least-squares fit of base parameters, if there was one.
    """
    out = []
    for row in _of_joints(values):
        unit, least = str(row.get("unit") or ""), number(row.get("least_squares"))
        before, after, floor = (quantity(row.get(key), unit) for key in ("before", "after", "floor"))
        named = {"joint": str(row["joint"]), "reading": READINGS[row["channel"]]}
        sizes = {"before": before, "after": after, "floor": floor, "times": fold(_times(row)) if _times(row) else "–"}
        out.append(named | sizes | {"least": "" if least is None else quantity(least, unit)})
    return out


def farthest(values: Mapping[str, Any]) -> str:
    """Return the joint farthest above its noise floor: `joint6 is left at 32 × its own`; empty if none is above `FAR`.

    Only the kind of reading that the record lists first is considered.
    """
    principal = _of_joints(values)[:1]
    same_kind = [row for row in _of_joints(values) if principal and row["channel"] == principal[0]["channel"]]
    worst = max(same_kind, key=_times, default=None)
    if worst is None or _times(worst) < FAR:
        return ""
    return f"{worst['joint']} is left at {fold(_times(worst))} × its own"


def _of_joints(values: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [row for row in rows(values, "channels") if row.get("channel") in READINGS]


def _times(row: Mapping[str, Any]) -> float:
    """Return the final error as a multiple of the noise floor; 0 if either is unknown."""
    after, floor = number(row.get("after")), number(row.get("floor"))
    return after / floor if after is not None and floor else 0.0
