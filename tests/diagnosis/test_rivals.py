"""Which rivals are listed beside an effect that was chosen."""

from types import SimpleNamespace

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.conclusion.rivals import grown_from
from vispeg.diagnosis.evidence.screen import Score
from vispeg.diagnosis.selection.judge import Judge


def judge() -> Judge:
    evidence = SimpleNamespace(
        blocks=lambda seconds: np.repeat(np.arange(40), 25),
        items=[SimpleNamespace(nj=1, measured=np.zeros((1000, 1)), valid=np.ones((1000, 1), bool))],
        tells=lambda difference: np.ones(len(difference), bool),
    )
    return Judge(evidence)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("rival", "where", "left", "refuted"),
    [
        ("rotor_inertia", "joint3", 79.0, True),  # play is what the rotor alone lacks
        ("rotor_inertia", "joint3", 2.0, False),  # hardly worse: the play may be none
        ("rotor_inertia", "joint4", 79.0, False),  # another rotor is no part of this gear
        ("coulomb_friction", "joint3", 79.0, False),
    ],
)
def test_what_the_chosen_effect_grew_from_is_no_rival_where_it_leaves_most_of_the_error(rival, where, left, refuted):
    """Play removes all of 100 000 noise variances, a rotor all but 79: a thousandth, and yet most of what was left."""
    rng = np.random.default_rng(0)
    spread = rng.uniform(0.9, 1.1, (40, 1))
    state = SimpleNamespace(loss=25.0 * 1.7 * spread)
    trial = SimpleNamespace(score=Score(EffectInstance.of(rival, where), 0.0), loss=25.0 * left * spread)
    assert grown_from(judge(), trial, state, "backlash(joint3)") == refuted  # type: ignore[arg-type]
