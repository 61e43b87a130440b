"""Numbers as people read them: three significant digits, SI prefixes, intervals rounded to what they support."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

PREFIXED = ("rad", "N m", "m", "s")  # units that get the prefixes m and µ, alone or as numerators


def number(value: Any) -> float | None:
    """Return `value` as a finite float, or None for None, NaN, infinity, text and booleans."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
        return None
    return float(value) if math.isfinite(value) else None


def plain(value: Any, digits: int = 3) -> str:
    """Return `value` with `digits` significant digits, with an exponent only if needed; `–` if it is no number."""
    x = number(value)
    if x is None:
        return "–"
    if x == 0.0:
        return "0"
    size = math.floor(math.log10(abs(float(f"{x:.{digits - 1}e}"))))
    if size < -4 or size > 5:
        mantissa, exponent = f"{x:.{digits - 1}e}".split("e")
        return f"{mantissa}e{int(exponent)}".replace("-", "−")
    return f"{x:z.{max(0, digits - 1 - size)}f}".replace("-", "−")


def prefix(size: float | None, unit: str) -> tuple[float, str]:
    """Return (factor, unit) such that `factor * size` reads well: (1e3, "mrad RMS") for 0.008 "rad RMS"."""
    base = next((u for u in PREFIXED if unit == u or unit.startswith((u + " ", u + "/"))), None)
    if base is None or not size:
        return 1.0, unit
    for factor, sign in ((1.0, ""), (1e3, "m"), (1e6, "µ")):
        if abs(size) * factor >= 0.1:
            return factor, unit.replace(base, sign + base, 1)
    return 1e6, unit.replace(base, "µ" + base, 1)


def quantity(value: Any, unit: str) -> str:
    """Return a value with its unit and a suitable prefix: `8.21 mrad RMS`."""
    x = number(value)
    if x is None:
        return "–"
    factor, name = prefix(x, unit)
    return f"{plain(x * factor)} {name}".strip()


def fold(ratio: float) -> str:
    """Return a ratio above one as text: `1.3`, `4.2`, `37`."""
    return f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:,.0f}"


def interval(value: Any, low: Any, high: Any) -> tuple[str, str]:
    """Return (value, interval) as text, with the decimals that give the interval's half-width two digits.

    Below 1e-4, value and interval have the same power of ten.
    """
    x, a, b = number(value), number(low), number(high)
    if x is None or a is None or b is None or not b > a:
        return plain(value, 4), "" if a is None or b is None else f"{plain(a, 4)} to {plain(b, 4)}"
    power = math.floor(math.log10(max(abs(x), abs(a), abs(b))))
    if power < -4:
        value, span = interval(x * 10.0**-power, a * 10.0**-power, b * 10.0**-power)
        ends = [f"{v}e−{-power}" if v.strip("−0.") else "0" for v in (value, *span.split(" to "))]
        return ends[0], f"{ends[1]} to {ends[2]}"
    decimals = 1 - math.floor(math.log10((b - a) / 2))
    if decimals > 6 or max(abs(x), abs(a), abs(b)) >= 1e6:
        return plain(x, 4), f"{plain(a, 4)} to {plain(b, 4)}"
    text = [f"{v:z.{max(0, decimals)}f}".replace("-", "−") for v in (x, a, b)]
    return text[0], f"{text[1]} to {text[2]}"


def scaled(value: Any, low: Any, high: Any, unit: str) -> tuple[str, str, str]:
    """Return (value, interval, unit) as text, with a prefix that suits the value, or the interval if the value is 0."""
    sizes = [abs(x) for x in map(number, (value, low, high)) if x is not None]
    size = (sizes[0] or max(sizes[1:], default=0.0)) if sizes else 0.0
    factor, name = prefix(size, unit)
    numbers = [None if x is None else x * factor for x in map(number, (value, low, high))]
    return *interval(*numbers), name


def rms(values: np.ndarray) -> float | None:
    """Return the root mean square of the finite entries; None if there are none."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else None
