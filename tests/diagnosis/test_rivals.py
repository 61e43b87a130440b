"""Which rivals are listed beside an effect that was chosen."""

from types import SimpleNamespace

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.conclusion.rivals import grown_from
from vispeg.diagnosis.findings import Score, Trial
from vispeg.diagnosis.selection import law
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.state import State
from vispeg.worlds.world import World


def judge() -> Judge:
    evidence = SimpleNamespace(
        blocks=lambda seconds: np.repeat(np.arange(40), 25),
        items=[SimpleNamespace(nj=1, measured=np.zeros((1000, 1)), valid=np.ones((1000, 1), bool))],
        tells=lambda difference: np.ones(len(difference), bool),
        stretches=lambda blocks: np.arange(40),
        unit="N m",
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


@pytest.mark.parametrize(
    ("best", "rival", "as_good"),
    [
        (1.0, 1.008, True),  # a hundredth of the noise
        (1.0, 90.0, False),  # a thousandth of what both remove, and ninety times what the chosen one leaves
        (61.0, 110.0, True),  # neither law is exact: they leave alike
        (61.0, 130.0, False),
        (4000.0, 4100.0, True),
    ],
)
def test_a_rival_is_equal_on_what_remains_not_on_what_both_remove(best, rival, as_good):
    """131 000 noise variances without either; every block of time alike, so that chance makes nothing of it."""
    spread = np.random.default_rng(1).uniform(0.9, 1.1, (40, 1))
    spread /= spread.mean()
    loss = [25.0 * value * spread for value in (rival, best)]
    assert equal(judge(), *loss, 131e3, remaining=True) == as_good
    assert equal(judge(), *loss, 131e3), "of candidates of a step the simpler one is taken"


def trial(*effects: str, new: str):
    """A trial of `new` beside `effects` in a chain of joints."""
    world = World().add(*(EffectInstance.of(name, "joint1") for name in (*effects, new)))
    score = Score(EffectInstance.of(new, "joint1"), 1.0)
    return Trial(score, SimpleNamespace(world=world), np.zeros((1, 1)), None)  # type: ignore[arg-type]


def test_a_step_says_what_may_stand_in_the_place_of_its_effect_while_the_others_stay():
    names = "coulomb_friction", "joint_bias", "cogging"
    world = World().add(*(EffectInstance.of(name, "joint1") for name in names))
    others = [trial(*names[:k], new="cable_spring") for k in range(3)]
    steps = [(best := trial(*names[:k], new=names[k]), [best, others[k]]) for k in range(3)]
    state = State(world, np.zeros((1, 1)), np.zeros(1), steps=steps)  # type: ignore[arg-type]
    step = state.brought(world.effects[2])
    assert step is not None and step[0] is steps[2][0] and step[1][1] is others[2]
    assert state.brought(world.effects[0]) is None, "others came in later"
    state.world = world.without("joint_bias", "joint1")
    assert state.brought(world.effects[2]) is None, "what it was tried beside went out again"


@pytest.mark.parametrize(
    ("rotor", "play", "stands"),
    [
        (1.35, 1.0, True),  # near the noise: a quarter of the error, and all that is left over the noise
        (1.35, 1.25, False),  # under half of what is left
        (1.02, 1.0, False),  # too little to show
        (80.0, 1.5, True),
        (80.0, 60.0, False),
    ],
)
def test_play_stands_behind_a_rotor_where_it_removes_most_of_what_is_left_over_the_noise(
    rotor, play, stands, monkeypatch
):
    monkeypatch.setattr(law, "present", lambda fit, index: True)
    monkeypatch.setattr(law, "bic_gain", lambda *args: 1.0)
    spread = np.random.default_rng(2).uniform(0.9, 1.1, (40, 1))
    spread /= spread.mean()
    state = SimpleNamespace(loss=25.0 * rotor * spread, world=World(), residual=None)
    score = Score(EffectInstance.of("backlash", "elbow"), 0.0, out=(EffectInstance.of("rotor_inertia", "elbow"),))
    better = SimpleNamespace(loss=25.0 * play * spread, fit=None, score=score)
    better.gain = judge().gain(state.loss, better.loss)
    search = SimpleNamespace(judge=judge(), evidence=SimpleNamespace(least_gain=0.02))
    assert law._stands_behind(search, state, better, better.gain.z) == stands  # type: ignore[arg-type]
