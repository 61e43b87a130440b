"""Text for errors as multiples of the noise floor, both as RMS.

Tests and thresholds work on mean squared whitened residuals (errors divided by their noise, 1 at the noise floor). What
a person reads is the root of them.
"""

from __future__ import annotations

import math


def times(ratio: float) -> str:
    """Return an RMS error over the noise floor as text: `1.07`, `4.2`, `1,250`."""
    return f"{ratio:.2f}" if ratio < 2 else f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:,.0f}"


def floors(mean_square: float) -> str:
    """Return the same text for a mean squared whitened residual."""
    return times(math.sqrt(mean_square))
