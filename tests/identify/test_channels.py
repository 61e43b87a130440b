"""Evidence is its channels side by side: what each predicts, and the numbers that the whole has always had."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from loops import iiwa_segment, recorded

from vispeg.core.effect import EffectInstance, searchable
from vispeg.core.seeds import stream
from vispeg.identify.inverse import evidence_for
from vispeg.recordings.recording import Control
from vispeg.robots.model import load
from vispeg.sim.rollout import simulate
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
OTHER = World().add(EffectInstance.of("coulomb_friction", "joint4", torque=1.0))
# mean squared whitened residual of the nominal arm and of OTHER, as rollouts and inverse dynamics gave it at first
PINNED = {"position": (0.890993, 1243.437), "unknown": (0.931912, 3.428542)}


def evidence(mode: str):
    segment = iiwa_segment("position", 3.0)
    rec = recorded(ROBOT, "iiwa14", World(), segment, stream(1, "channels"), h_max=1e-3)
    if mode == "unknown":
        rec = replace(rec, control=Control("unknown", rec.rate_hz), q_cmd=None, dq_cmd=None)
    return evidence_for([rec])


@pytest.mark.parametrize("mode", PINNED)
def test_numbers_are_what_they_were(mode):
    residuals = evidence(mode).residuals([World(), OTHER])
    assert [np.mean(r**2) for r in residuals] == pytest.approx(PINNED[mode], rel=1e-3)


def test_channels_stand_side_by_side():
    here = evidence("position")
    (item,) = here.items
    assert [c.kind for c in item.channels] == ["angle", "torque"] and here.unit == "rad"
    response = simulate(ROBOT, [OTHER], [item.segment], h_max=here.h_max, along=True)[0]
    angle, torque = item.channels
    expected = [
        (angle.measured - response.q[0]) / angle.sigma,
        (torque.measured - response.tau_joint[0]) / torque.sigma,
    ]
    expected = np.where(item.valid, np.concatenate(expected, axis=1), 0.0)
    np.testing.assert_array_equal(here.residuals([OTHER])[0].reshape(expected.shape), expected)


def test_inverse_dynamics_has_one_channel():
    here = evidence("unknown")
    assert [c.kind for c in here.items[0].channels] == ["needed"] and here.unit == "N m"


def test_each_effect_says_where_it_shows():
    """Delays, play and readings leave no trace in inverse dynamics; whatever moves the arm shows in a closed loop."""
    closed, open_ = evidence("position"), evidence("unknown")
    blind = {name for name, kind in searchable().items() if closed.sees(kind) and not open_.sees(kind)}
    assert {"command_delay", "sensor_delay", "backlash", "encoder_offset", "joint_elasticity"} <= blind
    samples = {"coulomb_friction", "viscous_friction", "payload", "link_mass", "torque_gain", "joint_bias"}
    assert not (samples | {"hysteresis"}) & blind, "hysteresis follows from the path"
