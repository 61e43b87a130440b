"""What a diagnosis of contact says of its phases, in a sentence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.recordings.regimes import REGIMES
from vispeg.report.record import rows
from vispeg.report.text.quantities import number, quantity
from vispeg.report.text.words import change

WHERE: dict[str, str] = dict(zip(REGIMES, ("in free air", "in presses", "in slides", "inside"), strict=False))
LEAST = 1.2  # times smaller, from which a fall is worth a sentence
COUNTED = "without what errors of sensor and kinematics explain"  # how the ladder's errors count


def phases(values: Mapping[str, Any]) -> str:
    """`In presses the force error falls 2.6-fold, from 1.37 N RMS to 0.523 N RMS.`

    Of the phase in which the squared error over its time falls most; empty where none has become 1.2 times smaller.
    The ladder's error leaves out what sensor and kinematics may do, this one is plain: measured less predicted.
    """
    best, most = "", 0.0
    for row in rows(values, "phases"):
        before, after, seconds = (number(row.get(key)) for key in ("before", "after", "seconds"))
        if before is None or after is None or seconds is None or before < LEAST * after:
            continue
        if (fell := seconds * (before**2 - after**2)) > most:
            name, most = str(row.get("phase")), fell
            ends = f"from {quantity(before, 'N RMS')} to {quantity(after, 'N RMS')}"
            best = f"{WHERE.get(name, 'in ' + name).capitalize()} the force error {change(before, after)}, {ends}."
    return best
