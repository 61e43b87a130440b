"""Forces across a part that wedges, from the wrench at the flange alone."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from clamped import BESIDE, SCENE, SLIP, TOP, G, bench
from straight import blocks

from vispeg.contact.errors.wedge import softness, wedging
from vispeg.worlds.world import World


def item(first: float, second: float, depth: float, axis: float = 0.0):
    """One block of a part that bears with `first` N on the mouth and `second` the other way at its tip."""
    tip, way = SCENE.tip, np.array([np.cos(axis), np.sin(axis), 0.0])
    force = (first - second) * way
    torque = np.cross([0, 0, tip - depth], first * way) - np.cross([0, 0, tip], second * way)
    origin = np.array([*SCENE.target[:2], SCENE.target[2] - depth + tip])
    return blocks([0], contact=np.r_[force, torque][None], origin=origin)


@pytest.mark.parametrize("axis", [0.0, 0.7, 2.0])
def test_a_couple_tells_both_forces_of_a_wedge(axis):
    got = wedging(item(446.0, 420.0, 0.017, axis))
    np.testing.assert_allclose(got, np.hypot(446.0, 420.0), rtol=1e-9)


def test_a_part_that_leans_on_one_wall_or_hangs_over_the_goal_does_not_wedge():
    assert wedging(item(0.0, 25.0, 0.017)) == 0.0, "one force at the tip"
    assert wedging(item(25.0, 0.0, 0.017)) == 0.0, "one force at the mouth"
    assert wedging(item(446.0, 420.0, -0.01)) == 0.0, "above it"


def test_softness_is_how_deep_one_contact_stands_per_newton():
    """The peg pressed on the fixture's top with 1 N: all its points of contact bear a share, and are as deep."""
    load = 1.0
    batch = bench([World()], (*BESIDE, TOP), 5e-4)
    batch.bind("qfrc_applied")[:, SLIP] = load
    for _ in range(1200):
        batch.step()
    data, model = batch.get_data(0), batch.get_model(0)
    mujoco.mj_forward(model, data)
    share = (load + model.body("peg").mass[0] * G) / data.ncon
    assert softness(SCENE) == pytest.approx(-data.contact.dist.mean() / share, rel=0.03)
