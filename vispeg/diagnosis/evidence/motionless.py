"""Refuse a diagnosis on recordings without motion, as nothing can be learnt or judged on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.recordings.recording import Recording


def motionless(rec: Recording) -> bool:
    """Return whether neither joints nor commands move beyond noise; a commanded robot at rest is informative."""
    still = dict.fromkeys(("q", "q_cmd", "ee_cmd"), RULES.still_angle) | {"tau_cmd": RULES.still_torque}
    for name, least in still.items():
        values = getattr(rec, name)
        if values is None:
            continue
        finite = np.where(np.isfinite(values), values, np.nan)
        columns = finite[:, ~np.isnan(finite).all(axis=0)]
        span = np.nanmax(columns, axis=0) - np.nanmin(columns, axis=0) if columns.size else np.zeros(1)
        if np.any(span > max(least, RULES.still_noise * rec.noise.get(name, 0.0))):
            return False
    return True


def refuse_motionless(fitted: Sequence[Recording], held_out: Sequence[Recording]) -> list[str]:
    """Return a message for each recording without motion.

    Raises:
        UserError: no fitted recording has motion, or no held-out one.
    """
    notes = []
    for recordings, use in ((fitted, "to learn from"), (held_out, "to judge on")):
        still = [rec for rec in recordings if motionless(rec)]
        if still and len(still) == len(recordings):
            others = f" (nor does it in the {len(still) - 1} others given with it)" if len(still) > 1 else ""
            message = f"there is no motion {use}: no joint and no command moves{others}"
            raise UserError(message, file=still[0].path, expected="a recording in which the joints move and turn back")
        notes += [f"{rec.name} has no motion {use}: no joint and no command moves" for rec in still]
    return notes
