"""The pieces of a hole are together as stiff as one contact, inside it alone."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mujoco import batch as mjb

from vispeg.contact.hand import grasp, hand
from vispeg.contact.pieces import Pieces, inside, stretches
from vispeg.robots.scene import build
from vispeg.sim.compiled import compiled

SCENE = build()
HAND = hand(SCENE, grasp(0.2, 5e-5))


def odds(solimp):
    """`d / (1 - d)`, to which a contact's stiffness at rest is proportional."""
    return solimp[..., 0] / (1 - solimp[..., 0])


def test_inside_pieces_share_the_stiffness_of_what_is_held_and_outside_each_has_it():
    model = compiled(HAND)
    batch = mjb.Batch(model, 2)
    batch.expand("geom_friction")[1, model.geom("peg").id, 0] = 0.5  # as an effect at the peg writes it
    pieces = Pieces(batch, model, HAND)
    walls = [g for g in range(model.ngeom) if model.geom(g).name.startswith("hole_wall")]
    solimp, held = batch.expand("geom_solimp"), model.geom("peg").id
    pieces.inside(True)
    share = odds(solimp[:, walls]) / odds(solimp[:, held])[:, None]
    config = SCENE.config
    bears_on = len(walls) * config.diameter / (2 * np.pi * (config.apothem + config.diameter))
    assert 3.0 < bears_on < 8.0
    np.testing.assert_allclose(share, 1 / bears_on, rtol=1e-9)
    pieces.inside(False)
    np.testing.assert_array_equal(solimp[:, walls], np.tile(solimp[:, [held]], (1, len(walls), 1)))
    np.testing.assert_array_equal(batch.expand("geom_friction")[:, walls, 0], [[0.3] * len(walls), [0.5] * len(walls)])


def test_a_contact_with_a_piece_follows_the_piece():
    """Its priority is above that of what is held, or else what is written to it would count for nothing."""
    model = compiled(HAND)
    assert model.geom("hole_wall0").priority > model.geom("peg").priority > model.geom("table").priority
    assert compiled(SCENE).geom("hole_wall0").priority < compiled(SCENE).geom("peg").priority, "the cell keeps its own"


def test_only_a_tip_below_the_bevel_is_inside():
    """One that presses on the top, and is read to be in it by the noise of kinematics, is not; nor is one far aside."""
    depth, aside = np.meshgrid([-5e-4, 2e-5, 9e-4, 1.5e-3, 0.02], [0.0, 1.4e-3, 0.03])
    n, down = depth.size, np.array([0.0, 1, 0, 0])
    place = np.zeros((n, 6))
    place[:, 0], place[:, 2] = aside.ravel(), depth.ravel()  # the hand's z points down
    goal = np.array(SCENE.target)
    path = SimpleNamespace(origin=goal + [0, 0, SCENE.tip], frame=down, place=place, goal=goal)
    within = inside(path, SCENE).reshape(depth.shape)
    np.testing.assert_array_equal(within, [[0, 0, 0, 1, 1], [0, 0, 0, 1, 1], [0] * 5])


@pytest.mark.parametrize(
    ("flag", "cut"),
    [([0, 0, 1, 1, 0, 0], [(1, 2), (2, 4), (4, 5)]), ([1] * 6, [(1, 5)]), ([0, 1, 1, 1, 1, 1], [(1, 5)])],
)
def test_a_window_is_cut_where_a_tip_goes_in_or_out(flag, cut):
    assert [(s.start, s.stop) for s in stretches(np.array(flag, bool), slice(1, 5))] == cut
