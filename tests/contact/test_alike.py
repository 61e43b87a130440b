"""A rival of a chosen effect has the parameters that this one acts by, before it is called worse."""

from __future__ import annotations

import pytest
from straight import Straight, search

from vispeg.contact.selection.profile import looked_for
from vispeg.contact.selection.search import lacking
from vispeg.core.effect import REGISTRY, EffectInstance, effect, told_apart_by
from vispeg.core.seeds import stream
from vispeg.worlds.world import World

FIXTURE = EffectInstance.of("fixture_compliance", "fixture", x=4e-5, y=5e-5)


def grasp(**values):
    return EffectInstance.of("peg_grasp_compliance", "peg", **values)


@pytest.mark.parametrize(
    ("has", "lacks"), [({}, {"x", "y"}), ({"x": 1e-5, "pitch": 1e-3}, {"y"}), ({"x": 1e-5, "y": 1e-5}, set())]
)
def test_a_rival_lacks_what_the_chosen_effect_acts_by(has, lacks):
    assert lacking(FIXTURE, grasp(**has)) == {("peg_grasp_compliance", name) for name in lacks}


def test_an_effect_that_is_not_confusable_lacks_no_parameter():
    assert not lacking(FIXTURE, EffectInstance.of("hole_offset", "fixture"))
    assert not lacking(FIXTURE, EffectInstance.of("fixture_compliance", "fixture"))
    assert not lacking(FIXTURE, EffectInstance.of("contact_stiffness", "peg")), "no parameter by these names"


def test_a_motion_that_tells_two_effects_apart_is_declared_by_one_of_them_for_both():
    kinds = [*(kind.name for kind in looked_for()), "camera_offset", "camera_delay", "encoder_offset", "focal_error"]
    assert told_apart_by("fixture_compliance", "peg_grasp_compliance") == ["insert-turned"]
    assert told_apart_by("camera_offset", "focal_error") == [effect("focal_error").told_from["camera_offset"]]
    assert all(told_apart_by(a, b) == told_apart_by(b, a)[::-1] for a in kinds for b in kinds)
    declared = [other for kind in REGISTRY.values() for other in kind.told_from]
    assert all(name in REGISTRY for name in declared)


def test_a_rival_is_fitted_with_what_it_lacked_and_with_nothing_else():
    """The screen freed the grasp along x alone; the chosen fixture acts along x and y."""
    along, across, other = 2e6 * stream(1, "alike").standard_normal((3, 120)) * [[2.0], [1.0], [1.0]]
    slopes = {("peg_grasp_compliance", "z"): other}
    for name in ("fixture_compliance", "peg_grasp_compliance"):
        slopes |= {(name, "x"): along, (name, "y"): across}
    evidence = Straight(4e-5 * along + 5e-5 * across, slopes)
    searching = search(evidence)
    evidence.absent = {("peg_grasp_compliance", k) for k in ("y", "z", "roll", "pitch", "yaw")}
    before = searching.start(World(), 0)
    (rival,), _ = searching.instead(before, FIXTURE)
    assert rival.key == ("peg_grasp_compliance", "peg")
    assert evidence.absent == {("peg_grasp_compliance", k) for k in ("z", "roll", "pitch", "yaw")}
    (trial,) = searching.try_all(before, [rival], 1)
    (grasped,) = trial.fit.world.effects
    assert (grasped.params["x"].value, grasped.params["y"].value) == pytest.approx((4e-5, 5e-5), rel=1e-3)
    assert float(trial.loss.sum()) < 1e-6 * float(before.loss.sum())
