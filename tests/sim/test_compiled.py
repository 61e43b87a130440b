"""What is left out of a step changes no motion, bit for bit."""

from __future__ import annotations

from copy import copy

import mujoco
import numpy as np
import pytest
from mujoco import batch as mjb

from vispeg.robots.model import load
from vispeg.sim.compiled import compiled, idle


def swung(model: mujoco.MjModel, friction: float) -> np.ndarray:
    """Angles (300, 4, 7) rad of four arms that torques drive about, through their limits too."""
    batch = mjb.Batch(model, 4, nthread=1)
    batch.expand("dof_frictionloss")[:] = friction * np.arange(1, 8)
    q, torque, out = batch.bind("qpos"), batch.bind("ctrl"), []
    random = np.random.default_rng(1)
    q[:] = [0.0, 0.5, 0.0, -1.2, 0.0, 0.9, 0.0]
    for k in range(300):
        torque[:] = 60.0 * np.sin(0.02 * k + np.arange(7)) + random.normal(size=(4, 7))
        batch.step()
        out.append(q.copy())
    return np.array(out)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_step_without_what_cannot_act_is_the_same_step(friction):
    lean = compiled(load("iiwa14"))
    whole = copy(lean)
    whole.opt.disableflags = 0
    assert lean.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT.value
    moved = swung(lean, friction)
    assert np.abs(moved).max() > 3.0
    np.testing.assert_array_equal(moved, swung(whole, friction))


def test_geoms_that_may_meet_still_do():
    spec = load("iiwa14").spec()
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 1
    assert not idle(spec.compile()) & mujoco.mjtDisableBit.mjDSBL_CONTACT.value
