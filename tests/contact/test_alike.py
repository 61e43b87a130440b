"""A rival of a chosen effect has the parameters that this one acts by, before it is called worse."""

from __future__ import annotations

import fits
import numpy as np
import pytest
from straight import Straight, search

from vispeg.contact.selection.alike import free_lacking, lacking, refitted
from vispeg.contact.selection.profile import looked_for
from vispeg.core.effect import REGISTRY, EffectInstance, effect, told_apart_by
from vispeg.core.seeds import stream
from vispeg.diagnosis.findings import Gain, Score, Trial
from vispeg.diagnosis.selection.state import State
from vispeg.worlds.world import World

FIXTURE = EffectInstance.of("fixture_compliance", "fixture", x=4e-5, y=5e-5)


def grasp(**values):
    return EffectInstance.of("peg_grasp_compliance", "peg", **values)


@pytest.mark.parametrize(
    ("has", "lacks"), [({}, {"x", "y"}), ({"x": 1e-5, "pitch": 1e-3}, {"y"}), ({"x": 1e-5, "y": 1e-5}, set())]
)
def test_a_rival_lacks_what_the_chosen_effect_acts_by(has, lacks):
    assert lacking(FIXTURE, grasp(**has)) == lacks


def test_an_effect_that_is_not_confusable_lacks_no_parameter():
    assert not lacking(FIXTURE, EffectInstance.of("hole_offset", "fixture"))
    assert not lacking(FIXTURE, EffectInstance.of("fixture_compliance", "fixture"))
    assert not lacking(FIXTURE, EffectInstance.of("contact_stiffness", "peg")), "no parameter by these names"


def test_only_the_parameters_that_a_rival_lacks_are_freed():
    idle = {("peg_grasp_compliance", k) for k in ("y", "roll", "pitch")} | {("fixture_compliance", "z")}
    evidence = Straight(np.ones(12), {})
    searching, evidence.absent = search(evidence), set(idle)
    assert free_lacking(searching, FIXTURE, grasp(x=4e-5))
    assert evidence.absent == idle - {("peg_grasp_compliance", "y")}
    assert not free_lacking(searching, FIXTURE, grasp(x=4e-5, y=4e-5))


def test_a_motion_that_tells_two_effects_apart_is_declared_by_one_of_them_for_both():
    kinds = [*(kind.name for kind in looked_for()), "camera_offset", "camera_delay", "encoder_offset", "focal_error"]
    assert told_apart_by("fixture_compliance", "peg_grasp_compliance") == ["insert-turned"]
    assert told_apart_by("camera_offset", "focal_error") == [effect("focal_error").told_from["camera_offset"]]
    assert all(told_apart_by(a, b) == told_apart_by(b, a)[::-1] for a in kinds for b in kinds)
    declared = [other for kind in REGISTRY.values() for other in kind.told_from]
    assert all(name in REGISTRY for name in declared)


@pytest.mark.parametrize("tried", [True, False])
def test_a_rival_that_lacked_something_or_was_not_tried_is_fitted_with_it(tried):
    """The grasp was fitted along x alone, or not at all; the chosen fixture and what is not alike stay as they were."""
    rng = stream(1, "alike")
    along, across, other = 2e6 * rng.standard_normal((3, 120)) * [[2.0], [1.0], [1.0]]
    slopes = {("hole_offset", "x"): other}
    for name in ("fixture_compliance", "peg_grasp_compliance"):
        slopes |= {(name, "x"): along, (name, "y"): across}
    evidence = Straight(4e-5 * along + 5e-5 * across, slopes)
    searching = search(evidence)
    evidence.absent = {("peg_grasp_compliance", k) for k in ("y", "z", "roll", "pitch", "yaw")}
    offset = EffectInstance.of("hole_offset", "fixture", x=1e-3)
    before = searching.start(World(), 0)
    kept = [(e, fits.fit(World().add(e))) for e in (FIXTURE, offset, *([grasp(x=4e-5)] if tried else []))]
    old = [Trial(Score(e, 1.0), fit, before.loss, Gain(0.0, 0.0, 0.0)) for e, fit in kept]
    state = State(World().add(FIXTURE), before.loss, evidence.residual(World().add(FIXTURE)), 0, steps=[(old[0], old)])
    refitted(searching, state)
    taken, trials = state.steps[0]
    after = {t.score.key[0]: t for t in trials}
    assert taken is old[0] is after["fixture_compliance"] and after["hole_offset"] is old[1]
    assert ("peg_grasp_compliance", "y") not in evidence.absent
    (new,) = after["peg_grasp_compliance"].fit.world.effects
    assert (new.params["x"].value, new.params["y"].value) == pytest.approx((4e-5, 5e-5), rel=1e-3)
    assert float(after["peg_grasp_compliance"].loss.sum()) < 1e-6 * float(before.loss.sum())
