"""Error of form: the part of a squared residual that comes from the contact law's own error (model discrepancy).

Unlike white noise, it is correlated between adjacent blocks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.contact.inputs import ContactItem
from vispeg.contact.phases import Phases
from vispeg.core.rules import RULES


def form(items: Sequence[ContactItem], residual: np.ndarray) -> float:
    """Return the drop of the squared residual that an effect must bring when added to others.

    No law of contact is exact, and some effect of the library always removes a little of another law's error of form,
    but none removes noise. The variance of white noise is estimated by half the mean square of successive differences
    between blocks of one phase. Source: von Neumann and others 1941, The mean square successive difference, Annals of
    Mathematical Statistics 12(2).

    Args:
        items: recordings.
        residual: whitened, of all items, flat.
    """
    ends = np.cumsum([i.measured.size for i in items])[:-1]
    white = sum(
        _white(r.reshape(i.measured.shape), i.phase) for i, r in zip(items, np.split(residual, ends), strict=True)
    )
    return RULES.form_beside * max(float(residual @ residual) - white, 0.0)


def _white(residual: np.ndarray, phase: Phases) -> float:
    """Return the squared residual (m, 6) expected of white noise with an item's successive differences."""
    valid, code = phase.valid, phase.code
    next_to = valid[1:] & valid[:-1] & (code[1:] == code[:-1])
    steps = np.diff(residual, axis=0)[next_to]
    return float(0.5 * np.sum(steps**2) / max(len(steps), 1) * valid.sum())
