"""A rival of a chosen effect has the parameters that this one acts by, before it is called worse."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from vispeg.contact.selection.alike import alike, freed, lacking
from vispeg.contact.selection.profile import looked_for
from vispeg.core.effect import EffectInstance

FIXTURE = EffectInstance.of("fixture_compliance", "fixture", x=4e-5, y=5e-5)


def grasp(**values):
    return EffectInstance.of("peg_grasp_compliance", "peg", **values)


@pytest.mark.parametrize(
    ("has", "lacks"), [({}, {"x", "y"}), ({"x": 1e-5, "pitch": 1e-3}, {"y"}), ({"x": 1e-5, "y": 1e-5}, set())]
)
def test_a_rival_lacks_what_the_chosen_effect_acts_by(has, lacks):
    assert lacking(FIXTURE, grasp(**has)) == lacks


def test_what_needs_no_motion_to_be_told_apart_lacks_nothing():
    assert not lacking(FIXTURE, EffectInstance.of("hole_offset", "fixture"))
    assert not lacking(FIXTURE, EffectInstance.of("fixture_compliance", "fixture"))
    assert not lacking(FIXTURE, EffectInstance.of("contact_stiffness", "peg")), "no parameter by these names"


def test_what_a_rival_lacks_is_moved_by_fits_again_and_nothing_else():
    idle = {("peg_grasp_compliance", k) for k in ("y", "roll", "pitch")} | {("fixture_compliance", "z")}
    search = SimpleNamespace(evidence=SimpleNamespace(absent=set(idle)))
    assert freed(search, FIXTURE, grasp(x=4e-5))
    assert search.evidence.absent == idle - {("peg_grasp_compliance", "y")}
    assert not freed(search, FIXTURE, grasp(x=4e-5, y=4e-5))


def test_effects_are_alike_both_ways():
    kinds = [kind.name for kind in looked_for()]
    assert alike("fixture_compliance", "peg_grasp_compliance")
    assert all(alike(a, b) == alike(b, a) for a in kinds for b in kinds)
