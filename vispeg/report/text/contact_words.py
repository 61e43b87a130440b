"""Sentences of a contact diagnosis on its phases: free air, pressing, sliding, inside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.recordings.regimes import REGIMES
from vispeg.report.record import rows
from vispeg.report.text.quantities import number, plain, quantity
from vispeg.report.text.words import NEAR_FLOOR, against_floor, change

# regime in words, for all but the last regime, impact
WHERE: dict[str, str] = dict(zip(REGIMES, ("in free air", "in presses", "in slides", "inside"), strict=False))
LEAST = 1.2  # smallest ratio of the errors before and after that gets a sentence


def phases(values: Mapping[str, Any]) -> str:
    """Return e.g. `In presses the force error falls 2.6-fold, from 1.37 N RMS to 0.523 N RMS.`

    It names the phase whose squared error, integrated over its time, falls most; empty if none falls by a factor of
    `LEAST`.
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


def left(values: Mapping[str, Any]) -> str:
    """Return e.g. `What is left shows most in slides: 0.710 N RMS there, 8.6 × the noise floor; largest at ...`.

    It names the phase whose squared error exceeds the noise floor most, integrated over its time; empty if none does.
    """
    best, most = "", 0.0
    for row in rows(values, "phases"):
        error, floor, seconds = (number(row.get(key)) for key in ("after", "floor", "seconds"))
        if error is None or not floor or seconds is None or error <= NEAR_FLOOR * floor:
            continue
        if (over := seconds * (error**2 / floor**2 - 1)) > most:
            name, most = str(row.get("phase")), over
            best = f"{WHERE.get(name, 'in ' + name)}: {quantity(error, 'N RMS')} there, {against_floor(error, floor)}"
    return f"What is left shows most {best}{_worst(values)}." if best else ""


def _worst(values: Mapping[str, Any]) -> str:
    """Return e.g. `; largest, 2.10 N, at 12.3 s of slide-2 with the tip x 3.1, y −0.2, z 0.4 mm from the goal`."""
    worst = values.get("worst_left")
    if not isinstance(worst, Mapping):
        return ""
    text = (
        f"; largest, {quantity(worst.get('force'), 'N')}, at {plain(worst.get('time_s'))} s of {worst.get('recording')}"
    )
    tip = worst.get("tip_m")
    if isinstance(tip, list) and len(tip) == 3:
        places = ", ".join(f"{axis} {plain(1e3 * v, 2)}" for axis, v in zip("xyz", tip, strict=True))
        text += f" with the tip {places} mm from the goal"
    return text
