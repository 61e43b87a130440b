"""Numbers of a contact that another law of contact may explain are tentative."""

from __future__ import annotations

import pytest

from vispeg.contact.law import unsure, within
from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.core.rules import RULES
from vispeg.worlds.world import World


@pytest.mark.parametrize(
    ("interval", "tentative"),
    [((1.5, 0.78, 2.9), True), ((0.16, 0.08, 0.34), False), ((0.4, 0.2, 0.6), True), ((5.0, 2.5, 9.0), False)],
)
def test_a_stiffness_within_a_factor_of_two_is_tentative_and_a_friction_never(interval, tentative):
    effects = (
        EffectInstance("contact_stiffness", "peg", {"scale": Value(*interval)}),
        EffectInstance("contact_friction", "peg", {"scale": Value(*interval)}),
    )
    assert unsure(World().add(*effects), 0) == ({"contact_stiffness(peg)"} if tentative else set())
    assert unsure(World().add(*effects), 1) == set(), "what the user gave is not asked"


def test_an_interval_reaches_the_law_where_any_of_its_values_does():
    assert within(0.1, 1 / RULES.law) and within(RULES.law, 9.0) and within(0.9, 1.1)
    assert not within(0.1, 0.99 / RULES.law) and not within(1.01 * RULES.law, 9.0)
