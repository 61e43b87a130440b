"""Torques that a recording's motion needs, by which units and joint orders are checked."""

from dataclasses import replace

import numpy as np
from loops import iiwa_segment, recorded

from vispeg.core.seeds import stream
from vispeg.robots.model import load
from vispeg.sim.units import needs_of
from vispeg.worlds.world import World


def test_needs_follow_the_recordings_order_of_joints():
    arm = load("iiwa14")
    rec = recorded(arm, "iiwa14", World("iiwa14"), iiwa_segment(), stream(1, "order"))
    order = [3, 0, 6, 1, 5, 2, 4]
    turned = replace(rec, joints=tuple(rec.joints[i] for i in order))
    motion = np.random.default_rng(1).normal(size=(3, 5, 7))
    one, other = needs_of(arm, rec), needs_of(arm, turned)
    assert one is not None and other is not None
    np.testing.assert_allclose(other(*motion[:, :, order]), one(*motion)[:, order], rtol=1e-9)
