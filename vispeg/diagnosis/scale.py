"""Text for errors as multiples of the noise floor, both as RMS.

Tests and thresholds work on mean squares in noise variances; what a person reads is their root.
"""

from __future__ import annotations

import math


def times(ratio: float) -> str:
    """How many noise floors an error is, as text: `1.07`, `4.2`, `1,250`."""
    return f"{ratio:.2f}" if ratio < 2 else f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:,.0f}"


def floors(mean_square: float) -> str:
    """Return the floors of a mean square, in noise variances."""
    return times(math.sqrt(mean_square))
