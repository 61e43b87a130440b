"""Where a pressed end bears: the hand turns about a tip that stays, until its springs hold the couple."""

from __future__ import annotations

import numpy as np
from pressed import recorded

from vispeg.contact.errors.bearing import bearing
from vispeg.contact.hand import stiffness
from vispeg.contact.run import evidence_of
from vispeg.core.rules import RULES


def test_the_correction_holds_the_couple_about_the_tip_and_the_tip_stays():
    evidence = evidence_of([recorded()])
    (item,) = evidence.items
    columns, springs = bearing(item), stiffness()
    pressed = item.phase.of("press")
    assert pressed.any() and len(columns) % 2 == 0
    lever = np.array([0.0, 0.0, item.source.scene.tip])
    radius = item.source.scene.config.diameter / 2
    for axis in (0, 1):
        column = np.sum(columns[axis::2], axis=0)  # of all presses
        force, torque = column[:, :3], column[:, 3:]
        couple = torque + np.cross(-lever, force)
        expected = RULES.bears_aside * radius * np.abs(item.phase.contact[:, 2])
        np.testing.assert_allclose(couple[pressed][:, axis], expected[pressed], rtol=1e-9)
        np.testing.assert_allclose(np.delete(couple, axis, axis=1), 0.0, atol=1e-12)
        moved = force / springs[:3] + np.cross(torque / springs[3:], lever)
        np.testing.assert_allclose(moved, 0.0, atol=1e-12)
        np.testing.assert_array_equal(column[~pressed], 0.0)
    for column in columns:
        seen = np.where(item.valid, column / item.sigma, 0.0).ravel()
        off = np.linalg.norm(evidence.nuisance.columns - seen[:, None], axis=0)
        assert off.min() < 1e-9 * np.linalg.norm(seen), "it is one of the errors that a diagnosis allows for"
