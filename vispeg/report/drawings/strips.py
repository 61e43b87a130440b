"""Very small drawings for table cells, as SVG: an interval within its bounds, and a bar."""

from __future__ import annotations

import math

from vispeg.report.drawings.figures import AFTER, MUTED, RULE
from vispeg.report.drawings.palette import day, themed
from vispeg.report.text.quantities import number

LENGTH, HEIGHT, MARGIN = 190.0, 18.0, 5.0


def place(value: float, low: float, high: float, scale: str = "linear") -> float:
    """Return the position of `value` between the bounds, 0 to 1, clipped; on a log scale if asked and possible."""
    if scale == "log" and low > 0 and value > 0:
        value, low, high = math.log(value), math.log(low), math.log(high)
    return min(1.0, max(0.0, (value - low) / (high - low))) if high > low else 0.5


def interval_strip(
    value: object,
    interval: tuple[object, object],
    bounds: tuple[object, object],
    null: object = None,
    scale: str = "linear",
) -> str:
    """Draw the bounds as a line, null as a tick, the 95 % interval as a bar, the value as a dot; "" without numbers."""
    x, a, b = number(value), number(interval[0]), number(interval[1])
    low, high = number(bounds[0]), number(bounds[1])
    if x is None or low is None or high is None or not high > low:
        return ""

    def at(v: float) -> float:
        return MARGIN + place(v, low, high, scale) * (LENGTH - 2 * MARGIN)

    middle = HEIGHT / 2
    parts = [_line(MARGIN, LENGTH - MARGIN, middle, 2, RULE)]
    zero = number(null)
    if zero is not None and low <= zero <= high:
        parts.append(f'<path d="M{at(zero):.1f} 3V{HEIGHT - 3:.0f}" style="stroke:{MUTED}" stroke-width="1.2"/>')
    if a is not None and b is not None:
        parts.append(_line(at(a), max(at(b), at(a) + 1), middle, 6, AFTER, opacity=0.4))
    parts.append(f'<circle cx="{at(x):.1f}" cy="{middle}" r="3.4" style="fill:{AFTER}"/>')
    return _wrap(parts)


def bar(share: float, colour: str = AFTER) -> str:
    """Draw a bar of `share` (0 to 1, clipped) of the full length."""
    full = LENGTH - 2 * MARGIN
    end = MARGIN + max(1.0, min(1.0, max(0.0, share)) * full)
    return _wrap([_line(MARGIN, MARGIN + full, HEIGHT / 2, 8, day("empty")), _line(MARGIN, end, HEIGHT / 2, 8, colour)])


def _line(x0: float, x1: float, y: float, width: float, colour: str, opacity: float = 1.0) -> str:
    return f'<path d="M{x0:.1f} {y:.1f}H{x1:.1f}" style="stroke:{colour}" stroke-width="{width}" opacity="{opacity}"/>'


def _wrap(parts: list[str]) -> str:
    body = "".join(parts)
    return f'<svg class="strip" viewBox="0 0 {LENGTH:.0f} {HEIGHT:.0f}" aria-hidden="true">{themed(body)}</svg>'
