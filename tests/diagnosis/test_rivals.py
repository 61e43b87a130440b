"""Which rivals are listed beside an effect that was chosen."""

import numpy as np
import pytest
from fits import evidence, fit, judge, lost

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.conclusion.rivals import grown_from
from vispeg.diagnosis.findings import Gain, Score, Trial
from vispeg.diagnosis.selection import law
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.search import Search
from vispeg.diagnosis.selection.state import State
from vispeg.worlds.world import World


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
    spread = rng.uniform(0.9, 1.1, 40)
    play, tried = (EffectInstance.of(*at) for at in (("backlash", "joint3"), (rival, where)))
    state = State(World().add(play), lost(1.7 * spread), np.zeros(1))
    gain = judge().gain(lost(1e5 * spread), lost(left * spread))
    other = Trial(Score(tried, 0.0), fit(World().add(tried)), lost(left * spread), gain)
    assert grown_from(judge(), other, state, play.label) == refuted


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
    spread = np.random.default_rng(1).uniform(0.9, 1.1, 40)
    spread /= spread.mean()
    loss = [lost(value * spread) for value in (rival, best)]
    assert equal(judge(), *loss, 131e3, remaining=True) == as_good
    assert equal(judge(), *loss, 131e3), "of candidates of a step the simpler one is taken"


def trial(*effects: str, new: str):
    """A trial of `new` beside `effects` in a chain of joints."""
    world = World().add(*(EffectInstance.of(name, "joint1") for name in (*effects, new)))
    score = Score(EffectInstance.of(new, "joint1"), 1.0)
    return Trial(score, fit(world), np.zeros((1, 1)), Gain(0.0, 0.0, 0.0))


def test_a_step_says_what_may_stand_in_the_place_of_its_effect_while_the_others_stay():
    names = "coulomb_friction", "joint_bias", "cogging"
    world = World().add(*(EffectInstance.of(name, "joint1") for name in names))
    others = [trial(*names[:k], new="cable_spring") for k in range(3)]
    steps = [(best := trial(*names[:k], new=names[k]), [best, others[k]]) for k in range(3)]
    state = State(world, np.zeros((1, 1)), np.zeros(1), steps=steps)
    step = state.step_that_added(world.effects[2])
    assert step is not None and step[0] is steps[2][0] and step[1][1] is others[2]
    assert state.step_that_added(world.effects[0]) is None, "others came in later"
    state.world = world.without("joint_bias", "joint1")
    assert state.step_that_added(world.effects[2]) is None, "what it was tried beside went out again"


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
def test_play_explains_more_a_rotor_where_it_removes_most_of_what_is_left_over_the_noise(rotor, play, stands):
    """Of white residuals, alike on the fitted and on the held-out recordings."""
    rng = np.random.default_rng(2)
    spread, noise = rng.uniform(0.9, 1.1, 40), rng.standard_normal(evidence().length)
    spread /= spread.mean()
    simple, richer = EffectInstance.of("rotor_inertia", "elbow"), EffectInstance.of("backlash", "elbow")
    state = State(World().add(simple), lost(rotor * spread), np.sqrt(rotor) * noise)
    better = fit(World().add(richer), residual=np.sqrt(play) * noise)
    gain = judge().gain(state.loss, lost(play * spread))
    trial = Trial(Score(richer, 0.0, out=(simple,)), better, lost(play * spread), gain)
    assert law._explains_more(Search(evidence(), judge()), state, trial, gain.z) == stands
