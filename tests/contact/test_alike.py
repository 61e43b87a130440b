"""A rival of a chosen effect has the parameters that this one acts by, before it is called worse."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from vispeg.contact.selection.alike import alike, freed, lacking, refitted
from vispeg.contact.selection.profile import looked_for
from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.findings import Score
from vispeg.worlds.world import World

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


def trial(placed, text):
    out = SimpleNamespace(score=Score(placed, 1.0), fit=SimpleNamespace(world=World().add(placed)), text=text)
    out.bare = out
    return out


@pytest.mark.parametrize("tried", [True, False])
def test_a_rival_that_lacked_something_or_was_not_tried_is_fitted_with_it(tried, monkeypatch):
    """The grasp was fitted along x alone, or not at all; the chosen fixture and what is not alike stay as they were."""
    monkeypatch.setattr(
        "vispeg.contact.selection.alike.places",
        lambda evidence, world: [(p.effect, p.where) for p in (FIXTURE, grasp())] + [("hole_offset", "fixture")],
    )
    taken, offset = trial(FIXTURE, "old"), trial(EffectInstance.of("hole_offset", "fixture", x=1e-3), "old")
    old = [taken, offset, *([trial(grasp(x=4e-5), "old")] if tried else [])]
    state = SimpleNamespace(world=World().add(FIXTURE), steps=[(taken, old)])
    search = SimpleNamespace(
        evidence=SimpleNamespace(absent={("peg_grasp_compliance", "y")}),
        probed=lambda world, where: [SimpleNamespace(placed=grasp(x=4e-5), key=k, gain=1.0) for k in where],
        start=lambda world, n_fixed: SimpleNamespace(world=world),
        try_all=lambda before, scores, n_fixed, tested: [trial(s.placed, "new") for s in scores],
        tested=lambda before: 1,
    )
    refitted(search, state, 0)
    after = {t.score.key[0]: t.text for t in state.steps[0][1]}
    assert after == {"fixture_compliance": "old", "hole_offset": "old", "peg_grasp_compliance": "new"}
    assert state.steps[0][0] is taken and not search.evidence.absent
