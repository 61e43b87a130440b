"""Floors of phases whose law of contact is least certain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from straight import DOWN, blocks

from vispeg.contact.drive import Driven
from vispeg.contact.errors.floors import floors
from vispeg.core.rules import RULES
from vispeg.recordings.regimes import FREE, INSIDE, PRESS

FORCE = 50.0  # N


def floor(tilt: float) -> np.ndarray:
    """Return the floors of force of a rest, an insertion and a press with `FORCE`, of a hand tilted by `tilt` rad.

    No block is simulated, so that the floors are those of the law of contact alone.
    """
    code = np.repeat([FREE, INSIDE, PRESS], 20)
    contact = np.outer(code != FREE, [FORCE, 0, 0, 0, 0, 0])
    item = blocks(code, used=np.zeros(len(code), bool), contact=contact)
    frame = (Rotation.from_euler("x", tilt) * Rotation.from_quat(DOWN, scalar_first=True)).as_quat(scalar_first=True)
    phase = replace(item.phase, rest=slice(0, 20), resting=code == FREE, windows=())
    item = replace(item, path=replace(item.path, frame=frame), phase=phase)
    nothing = np.zeros((1, len(code), 6))
    return floors(item, Driven(nothing, nothing[:, 0], nothing), 1)[:, :3]


@pytest.mark.parametrize("tilt", [0.15, 0.07])
def test_a_part_that_is_tilted_in_the_goal_may_wedge(tilt):
    """Its floor has more of the force, in proportion to the square of the tilt."""
    upright, tilted = floor(0.0), floor(np.arcsin(tilt))
    inside = slice(20, 40)
    form, part = RULES.floor_form[INSIDE], RULES.floor_share[INSIDE]
    np.testing.assert_allclose(upright[inside], np.hypot(form, part * FORCE))
    np.testing.assert_allclose(tilted[inside], np.hypot(form, (part + RULES.floor_wedged * tilt**2) * FORCE))
    np.testing.assert_array_equal(tilted[40:], upright[40:], err_msg="nothing wedges a press on a surface")
