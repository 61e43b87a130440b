"""A soft layer on the fixture is no effect of the library: what looks like one is not called identified."""

from __future__ import annotations

from dataclasses import replace

import pytest

from vispeg.contact.selection.confounded import of_layer
from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.diagnosis.findings import Verdict
from vispeg.report.text.words import verdict as in_words
from vispeg.worlds.world import World

FOUND = Verdict("identified", "held-out error fell")
SOFT = EffectInstance.of("contact_stiffness", "peg", scale=0.1)
RAISED = EffectInstance.of("hole_offset", "fixture", z=1.2e-3)


def test_a_raised_soft_contact_is_ambiguous():
    """In whichever order, and whether the fixture stands higher or the part hangs lower."""
    lower = EffectInstance.of("grip_pose", "peg", z=1e-3)
    for effects in ((RAISED, SOFT), (SOFT, RAISED), (SOFT, lower)):
        verdict = of_layer(FOUND, World(effects=effects), 0)
        assert verdict.verdict == "ambiguous"
        assert "gasket" in verdict.reason and all(e.label in verdict.reason for e in effects)


@pytest.mark.parametrize(
    "effects",
    [
        (SOFT,),
        (RAISED,),
        (EffectInstance.of("contact_stiffness", "peg", scale=3.0), RAISED),
        (SOFT, EffectInstance.of("hole_offset", "fixture", z=-1.2e-3)),
        (SOFT, EffectInstance.of("hole_offset", "fixture", x=1.2e-3)),
        (SOFT, replace(RAISED, params={**RAISED.params, "z": Value(1e-4, -2e-4, 4e-4)})),
    ],
)
def test_effects_unlike_a_layer_stay_identified(effects):
    """One of the two alone, a harder contact, a lower fixture, one beside its place, a height that may be none."""
    assert of_layer(FOUND, World(effects=effects), 0) is FOUND


def test_only_what_was_found_counts_and_no_verdict_is_raised():
    """A model that was given with one of them is believed; `unexplained` stays."""
    assert of_layer(FOUND, World(effects=(SOFT, RAISED)), 1) is FOUND
    worse = Verdict("unexplained", "a residual remains")
    assert of_layer(worse, World(effects=(SOFT, RAISED)), 0) is worse


def test_the_page_says_what_it_may_be():
    """The reason stands in the report where no effect has a rival."""
    record = {
        "verdict": "ambiguous",
        "reason": of_layer(FOUND, World(effects=(SOFT, RAISED)), 0).reason,
        "effects": [{"effect": e.effect, "where": e.where, "params": {}} for e in (SOFT, RAISED)],
    }
    text = in_words(record)
    assert "soft layer" in text and "cannot tell its members" not in text
