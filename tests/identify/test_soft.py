"""A soft null space lets a wrong model drift: then the torques that the loop asked for drive the models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from loops import iiwa_segment, one, recorded

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.identify.evidence import Evidence
from vispeg.identify.loops.soft import as_torque_controlled, without_drift
from vispeg.recordings.recording import Recording
from vispeg.robots.model import load
from vispeg.sim.compiled import nominal_of
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
TILTED = World().add(EffectInstance.of("gravity_tilt", "base", roll=0.05, pitch=-0.04))
SEGMENT = iiwa_segment("osc", 4.0, seed=2)


@pytest.fixture(scope="module")
def tilted() -> Recording:
    return recorded(ROBOT, "iiwa14", TILTED, SEGMENT, stream(2, "tilted"))


def test_what_the_law_asks_for_is_what_the_drives_got():
    """Without noise and with ideal drives the motors' torque of the next tick, gravity at the reading taken off."""
    y = one(ROBOT, TILTED, SEGMENT)
    rec = recorded(ROBOT, "iiwa14", TILTED, SEGMENT, stream(2, "quiet"))
    rec = replace(rec, q=y.q[0], dq=y.dq[0])
    weight = nominal_of(ROBOT, len(rec.q)).gravity(rec.q)
    asked = as_torque_controlled(rec, ROBOT).tau_cmd
    assert asked is not None
    np.testing.assert_allclose((asked + weight)[1:-1], y.tau_motor[0][2:], atol=1e-9)
    limit = np.full(7, 5.0)
    cut = as_torque_controlled(replace(rec, control=replace(rec.control, torque_limit=limit)), ROBOT).tau_cmd
    np.testing.assert_allclose(cut + weight, np.clip(asked + weight, -5.0, 5.0), atol=1e-9)


def test_a_model_that_drifts_is_compared_in_the_measured_posture(tilted):
    """The nominal arm drifts off by a tenth of a radian and more; the right model still stands at the noise floor."""
    evidence = Evidence([tilted])
    followed = without_drift(evidence, World())
    assert followed.recordings[0].control.mode == "torque"
    assert any("drift" in note for note in followed.notes)
    gap = [e.rms_error(e.residuals([World()])[0]) for e in (evidence, followed)]
    assert gap[0] > RULES.posture and gap[1] < 0.2 * gap[0]
    (residual,) = followed.residuals([TILTED])
    assert residual @ residual / followed.count == pytest.approx(1.0, abs=0.3)


def test_a_model_that_stays_near_keeps_its_loop(tilted):
    evidence = Evidence([tilted])
    assert without_drift(evidence, TILTED) is evidence


def test_a_missing_reading_gives_no_torque(tilted):
    q = tilted.q.copy()
    q[7, 3] = np.nan
    asked = as_torque_controlled(replace(tilted, q=q), ROBOT).tau_cmd
    assert asked is not None and np.isnan(asked[7]).all() and np.isfinite(asked[20:]).all()


def test_a_missing_reading_changes_no_torque_around_it(tilted):
    """Without recorded velocities, which are differentiated from the angles; the greatest torque is some 20 N m."""
    q = tilted.q.copy()
    q[500] = np.nan
    whole, gapped = (
        as_torque_controlled(replace(tilted, q=angles, dq=None), ROBOT).tau_cmd for angles in (tilted.q, q)
    )
    assert whole is not None and gapped is not None
    rest = np.arange(len(q)) != 500
    np.testing.assert_allclose(gapped[rest], whole[rest], atol=1.0)
