"""Which rivals are listed beside an effect that was chosen."""

import numpy as np
import pytest
from fits import evidence, fit, judge, lost
from loops import hinge, swings

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.conclusion.rivals import _put_in, _tried, compared, grown_from
from vispeg.diagnosis.findings import Gain, Score, Trial
from vispeg.diagnosis.record import candidates
from vispeg.diagnosis.selection import law
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.diagnosis.selection.state import State
from vispeg.identify.evidence import Evidence
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
    state = State(World().add(play), lost(1.7 * spread), np.zeros(1), 0)
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
    state = State(world, np.zeros((1, 1)), np.zeros(1), 0, steps=steps)
    step = state.step_that_added(world.effects[2])
    assert step is not None and step[0] is steps[2][0] and step[1][1] is others[2]
    assert state.step_that_added(world.effects[0]) is None, "others came in later"
    state.world = world.without("joint_bias", "joint1")
    assert state.step_that_added(world.effects[2]) is None, "what it was tried beside went out again"


def alone(*trials: Trial, beside: tuple[str, ...] = ()) -> State:
    """The state of a search with the one step of these trials, and the first effect of its first trial."""
    world = World().add(*(EffectInstance.of(name, "joint1") for name in (*beside, trials[0].score.placed.effect)))
    return State(world, np.zeros((1, 1)), np.zeros(1), 0, steps=[(trials[0], [*trials])])


def test_rivals_of_a_single_effect_are_those_tried_in_its_place_in_the_present_world():
    search, (placed,) = Search(evidence(), judge()), World().add(EffectInstance.of("payload", "joint1")).effects
    best, other = trial(new="payload"), trial(new="cogging")
    assert _tried(search, alone(best, other), placed, 1) == (best, [best, other])
    assert _tried(search, alone(best), placed, 1) is None, "a load put together of links: nothing else was tried"
    late, later = (trial("cable_spring", new=name) for name in ("payload", "cogging"))
    assert _tried(search, alone(late, later), placed, 1) is None, "they were tried beside an alias that went out"
    assert _tried(search, alone(other, best), placed, 1) is None, "another effect's step"
    members = World().add(placed, EffectInstance.of("joint_bias", "joint1"))
    group = Trial(Score(placed, 1.0, members.effects[1:]), fit(members), np.zeros((1, 1)), Gain(0.0, 0.0, 0.0))
    assert _tried(search, alone(group, other), placed, 1) == (group, [group, other]), "all were tried from the start"


def test_what_cannot_be_told_from_an_effect_is_recorded_as_such():
    spread = np.random.default_rng(3).uniform(0.9, 1.1, 40)
    names = "coulomb_friction", "viscous_friction", "cable_spring"
    chosen, *others = (EffectInstance.of(name, "hinge") for name in names)
    state = State(World().add(chosen), lost(spread), np.zeros(1), 0)
    losses = lost(spread * (1.0 + 1e-4)), lost(30.0 * spread)
    trials = [
        Trial(Score(e, 1.0), fit(World().add(e)), loss, judge().gain(lost(99.0 * spread), loss))
        for e, loss in zip(others, losses, strict=True)
    ]
    rivals = compared(judge(), state, chosen.label, trials, 99.0)
    said = {row["effect"]: row["rejected_because"] for row in candidates(state, [rivals])}
    assert [t.score.placed.effect for t in rivals.equals] == ["viscous_friction"]
    assert said == {
        "viscous_friction": "indistinguishable from coulomb_friction(hinge)",
        "cable_spring": "explains less than coulomb_friction(hinge)",
    }


def test_a_rival_in_the_place_of_an_effect_removed_what_both_removed_and_leaves_nothing_superfluous():
    """Dry friction takes the place of viscous friction, beside which a bias stood."""
    out = swings(hinge("coulomb_friction", torque=0.8), 2, 2.0)
    search = Search(Evidence(out[:1]), Judge(Evidence(out[1:])))
    viscous, bias, dry = (
        EffectInstance.of(name, "hinge", **values)
        for name, values in [
            ("viscous_friction", {"damping": 0.3}),
            ("joint_bias", {"torque": 0.01}),
            ("coulomb_friction", {"torque": 0.7}),
        ]
    )
    nothing = search.start(World())
    state = search.start(World().add(bias, viscous), 0)
    first = Trial(Score(viscous, 0.0), state.fit, state.loss, search.judge.gain(nothing.loss, state.loss))
    state.steps, state.first, state.slight = [(first, [first])], nothing.first, frozenset({bias.label})
    (rival,) = search.try_all(search.start(World().add(bias), 0), [Score(dry, 0.0)], 1)
    _put_in(search, state, rival, viscous.label)
    assert [e.label for e in state.world.effects] == [dry.label] and not state.slight
    assert state.removed_by(dry) == pytest.approx(nothing.first - search.judge.mean(rival.loss))


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
    state = State(World().add(simple), lost(rotor * spread), np.sqrt(rotor) * noise, 0)
    better = fit(World().add(richer), residual=np.sqrt(play) * noise)
    gain = judge().gain(state.loss, lost(play * spread))
    trial = Trial(Score(richer, 0.0, out=(simple,)), better, lost(play * spread), gain)
    assert law._explains_more(Search(evidence(), judge()), state, trial, gain.z) == stands
