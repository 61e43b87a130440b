"""What a part bears on: inside, pieces that are together as stiff as one contact; beside the mouth, one whole top."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from mujoco import batch as mjb
from straight import path

from vispeg.contact.hand import hand
from vispeg.contact.pieces import ALONG, BESIDE, INSIDE, LEAST, OVER, Pieces, less_damped, odds, stretches, tip_places
from vispeg.effects.contact.contact_stiffness import scaled
from vispeg.robots.hole import TOUCHED, UNTOUCHED
from vispeg.robots.scene import build
from vispeg.sim.compiled import compiled

SCENE = build()
HAND = hand(SCENE)


def test_inside_pieces_share_the_stiffness_of_what_is_held_and_outside_each_has_it():
    model = compiled(HAND)
    batch = mjb.Batch(model, 2)
    batch.expand("geom_friction")[1, model.geom("peg").id, 0] = 0.5  # as an effect at the peg writes it
    pieces = Pieces(batch, model, HAND)
    walls = [g for g in range(model.ngeom) if model.geom(g).name.startswith("hole_wall")]
    solimp, held = batch.expand("geom_solimp"), model.geom("peg").id
    pieces.at(INSIDE)
    share = odds(solimp[:, walls]) / odds(solimp[:, held])[:, None]
    config = SCENE.config
    bears_on = len(walls) * config.diameter / (2 * np.pi * (config.apothem + config.diameter))
    assert 3.0 < bears_on < 8.0
    np.testing.assert_allclose(share, 1 / bears_on, rtol=1e-9)
    pieces.at(OVER)
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
    where = tip_places(_path(aside.ravel(), depth.ravel()), SCENE).reshape(depth.shape)
    np.testing.assert_array_equal(where == INSIDE, [[0, 0, 0, 1, 1], [0, 0, 0, 1, 1], [0] * 5])
    np.testing.assert_array_equal(where >= BESIDE, [[0] * 5, [0] * 5, [1] * 5])


def test_what_slides_beside_the_mouth_is_told_from_what_rests_there():
    """From 30 to 40 mm aside, standing, at 50 mm/s, and standing again; then in over the mouth's rim."""
    aside = np.concatenate([np.full(200, 0.03), np.linspace(0.03, 0.04, 200), np.full(200, 0.04), [0.01] * 100])
    where = tip_places(_path(aside, np.zeros(len(aside))), SCENE)
    assert set(where[:180]) == set(where[420:580]) == {BESIDE}
    assert set(where[220:380]) == {ALONG}
    assert set(where[-100:]) == {OVER}


def _path(aside, depth):
    """A tip that far off the goal's axis and below its mouth, a sample a millisecond."""
    place = np.zeros((len(aside), 6))
    place[:, 0], place[:, 2] = aside, depth  # the hand's z points down
    return path(place, np.array(SCENE.target) + [0, 0, SCENE.tip])


def test_beside_the_mouth_one_top_is_touched_and_the_pieces_are_not():
    model = compiled(HAND)
    batch = mjb.Batch(model, 2)
    pieces = Pieces(batch, model, HAND)
    touched = batch.expand("geom_contype")
    top, part = model.geom("hole_top").id, [model.geom(n).id for n in ("hole_wall0", "hole_plate3")]
    for where, whole in ((OVER, False), (INSIDE, False), (BESIDE, True), (ALONG, True)):
        pieces.at(where)
        assert set(touched[:, top]) == {TOUCHED if whole else UNTOUCHED}
        assert set(touched[:, part].ravel()) == {UNTOUCHED if whole else TOUCHED}


def test_what_slides_on_a_soft_top_is_less_damped_and_nothing_else_is():
    model = compiled(HAND)
    batch, held, top = mjb.Batch(model, 2), model.geom("peg").id, model.geom("hole_top").id
    solref, solimp = batch.expand("geom_solref"), batch.expand("geom_solimp")
    solref[1, held], solimp[1, held] = scaled(solref[1, held], solimp[1, held], 0.1)
    pieces = Pieces(batch, model, HAND)
    pieces.at(ALONG)
    np.testing.assert_allclose(solref[:, top], [solref[0, held], solref[1, held] * [10, 0.1]], rtol=1e-9)
    for where in (BESIDE, OVER):
        pieces.at(where)
        np.testing.assert_array_equal(solref[:, top], solref[:, held])
        np.testing.assert_array_equal(solimp[:, top], solimp[:, held])


@pytest.mark.parametrize("scale", [0.1, 0.03])
def test_a_part_that_slides_stands_as_deep_as_one_at_rest(scale):
    """With the cell's law as it is, a soft contact is not felt where it slides: MuJoCo lifts what does."""
    solref, solimp = np.array([0.003, 1.0]), np.array([0.95, 0.99, 2e-4, 0.5, 2.0])
    soft = scaled(solref, solimp, scale)
    law = less_damped(soft[0], np.array(scale)), soft[1]
    rest, moving = depth(law, 0.0), depth(law, 0.06)
    assert rest == pytest.approx(depth(soft, 0.0), rel=0.01), "at rest dampers do nothing"
    assert depth(soft, 0.06) < 0.4 * rest
    assert moving == pytest.approx(rest, rel=0.25)
    np.testing.assert_allclose(less_damped(solref, np.array([1.0, 0.0])), [solref, [0.003 / LEAST, LEAST]])


def depth(law, speed, load=12.0):
    """m: mean depth of a disc that a hand's springs lead over a plate."""
    spec = mujoco.MjSpec()
    spec.option.gravity, spec.option.timestep, spec.option.impratio = (0, 0, 0), 1e-3, 10.0
    spec.option.cone, spec.option.integrator = mujoco.mjtCone.mjCONE_ELLIPTIC, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.2, 0.2, 0.01), pos=(0, 0, -0.01))
    body = spec.worldbody.add_body(pos=(0, 0, 0.04))
    for axis in np.eye(3):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    disc = body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=(0.008, 0.04, 0), mass=0.8, priority=1, condim=3)
    disc.friction, disc.solref, disc.solimp = (0.3, 0.002, 1e-5), law[0], law[1]
    model = spec.compile()
    data, stiff = mujoco.MjData(model), 7700.0
    damped, heights = 2 * np.sqrt(0.8 * stiff), []
    for tick in range(1200):
        goal = np.array([speed * tick * 1e-3, 0.0, data.qpos[2]])
        data.qfrc_applied[:] = stiff * (goal - data.qpos) + damped * ([speed, 0, 0] - data.qvel) - [0, 0, load]
        mujoco.mj_step(model, data)
        heights.append(data.qpos[2])
    return -float(np.mean(heights[500:]))


@pytest.mark.parametrize(
    ("flag", "cut"),
    [([0, 0, 1, 1, 0, 0], [(1, 2), (2, 4), (4, 5)]), ([1] * 6, [(1, 5)]), ([0, 1, 1, 1, 1, 1], [(1, 5)])],
)
def test_a_window_is_cut_where_a_tip_goes_in_or_out(flag, cut):
    assert [(s.start, s.stop) for s in stretches(np.array(flag), slice(1, 5))] == cut
