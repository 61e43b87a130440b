"""What every arm has is found in every joint at once."""

from dataclasses import replace

import numpy as np
import pytest
from loops import ARM, drive, recorded

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import varied
from vispeg.core.seeds import stream
from vispeg.diagnosis.conclusion import rivals
from vispeg.diagnosis.evidence.localise import joint_z
from vispeg.diagnosis.evidence.screen import groups, screen
from vispeg.diagnosis.evidence.signatures import Signature
from vispeg.diagnosis.selection import prune
from vispeg.diagnosis.selection.cross import Cross
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.names import Exchange, never_named
from vispeg.diagnosis.selection.search import Search
from vispeg.identify.evidence import Evidence
from vispeg.robots.model import load
from vispeg.worlds.world import World

HIDDEN = (
    EffectInstance.of("coulomb_friction", "shoulder", torque=0.5),
    EffectInstance.of("coulomb_friction", "elbow", torque=0.4),
    EffectInstance.of("viscous_friction", "shoulder", damping=0.6),
    EffectInstance.of("viscous_friction", "elbow", damping=0.5),
)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Friction of both kinds in both joints, on three motions."""
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    robot, out = load(path), []
    for i in range(3):
        t = np.arange(700) * 5e-3
        swing = 1 - np.cos(2 * np.pi * np.outer(t, [0.7 + 0.2 * i, 1.1 - 0.2 * i]))
        s = drive(robot, "position", 0.0, command=0.4 * swing, seconds=3.5, rate=200.0, kp=60.0, kd=4.0)
        out.append(recorded(robot, robot.source, World().add(*HIDDEN), s, stream(5, i)))
    return out


def test_a_group_has_every_joint_once(recordings):
    evidence = Evidence(recordings[:1])
    found = groups(evidence, World())
    friction = next(g for g in found if ("coulomb_friction", "elbow") in g)
    assert sorted(friction) == sorted((e.effect, e.where) for e in HIDDEN)
    assert all(len(g) == len(set(g)) for g in found)
    left = groups(evidence, World().add(HIDDEN[0]))
    assert ("coulomb_friction", "shoulder") not in [p for g in left for p in g]
    assert not any(("coulomb_friction", "elbow") in g for g in groups(evidence, World(), {"friction"}))


@pytest.fixture(scope="module")
def searched(recordings):
    """A search, and the state that it ends with: what is hidden is fitted."""
    search = Search(Evidence(recordings[:2]), Judge(Evidence(recordings[2:])))
    state = search.start(World(recordings[0].robot))
    (fit,) = search.fits([state.world.add(*HIDDEN)], 0)
    state.take(fit, search.judge.losses([fit.world])[0])
    state.cross = search.cross.loss_of(fit, fit.residual)
    return search, state


@pytest.mark.slow
def test_friction_of_every_joint_is_named_with_its_size(recordings, searched):
    state = searched[0].run(World(recordings[0].robot))
    assert {e.label for e in state.world.effects} == {e.label for e in searched[1].world.effects}
    assert [best.score.label for best, _ in state.steps] == ["coulomb_friction + viscous_friction(each)"]
    found = {(e.effect, e.where): e.params for e in state.world.effects}
    assert set(found) == {(e.effect, e.where) for e in HIDDEN}
    for e in HIDDEN:
        for name, value in e.params.items():
            p = found[e.effect, e.where][name]
            assert p.value == pytest.approx(value.value, rel=0.02) and 0 < p.low < value.value * 1.02


class Strict(Search):
    """A search by whose held-out recordings nothing is a visible share."""

    def needed(self, state, index, gain):
        """Need nothing."""
        return False


class Careless(Judge):
    """A judge who sees no difference."""

    def gain(self, before, after, crossed=None):
        """Judge that nothing is gained."""
        return super().gain(before, before)


def test_what_the_held_out_recordings_want_stays_and_is_no_name_where_it_is_not_visible(searched):
    search, state = Strict(searched[0].evidence, searched[0].judge), searched[1]
    idle = EffectInstance.of("joint_bias", "elbow")
    (fit,) = search.fits([state.world.add(idle)], 0)
    here = replace(state, slight=frozenset())
    here.take(fit, search.judge.losses([fit.world])[0])
    here.cross = search.cross.loss_of(fit, fit.residual)
    prune.prune(search, here)
    assert {e.label for e in here.world.effects} == {e.label for e in HIDDEN}
    assert here.slight == {e.label for e in HIDDEN} == never_named(here)
    search = Search(search.evidence, search.judge)
    search.cross = Cross(Careless(search.evidence))  # the fitted recordings call every one useless
    prune.prune(search, here)
    assert len(here.world.effects) == len(HIDDEN) and not here.slight and not never_named(here)


def test_slight_effects_are_those_of_the_present_model(searched):
    """A refused removal shows that its effect is needed; the others are slight, and none of an earlier model is."""
    search, state = Strict(searched[0].evidence, Careless(searched[0].judge.evidence)), searched[1]
    here = replace(state, slight=frozenset({"gone(elbow)"}))
    prune.prune(search, here)
    labels = {e.label for e in here.world.effects}
    assert labels == {e.label for e in HIDDEN} and here.slight < labels and len(here.slight) == len(labels) - 1


def start(name):
    return {m: effect(name).params[m].start for m in effect(name).magnitudes}


class Asked(Search):
    """A search whose linear model proposes these exchanges."""

    def __init__(self, like: Search, *proposed: Exchange):
        super().__init__(like.evidence, like.judge)
        self.proposed = proposed

    def exchanges(self, state):
        """Propose them."""
        return list(self.proposed)


@pytest.mark.slow
def test_rivals_fitted_side_by_side_are_those_fitted_one_after_the_other(searched, monkeypatch):
    state = searched[1]
    names = ("rotor_inertia", "hysteresis", "joint_bias")
    asked = [
        Exchange(placed.label, 1.0, (), (EffectInstance.of(name, placed.where, **start(name)),))
        for placed, name in zip(state.world.effects[1:], names, strict=True)
    ]
    search = Asked(searched[0], *asked)
    with varied(at_floor=np.inf):  # the linear model's proposals alone
        together = rivals.find_rivals(search, state, lambda text: None)
        monkeypatch.setattr(rivals, "AT_ONCE", 1)
        alone = rivals.find_rivals(Asked(searched[0], *asked), state, lambda text: None)
    assert [r.label for r in together] == [e.label for e in state.world.effects]
    assert [len(r.tried) for r in together] == [0, 1, 1, 1]
    for a, b in zip(together, alone, strict=True):
        assert [t.score.label for t in a.equals] == [t.score.label for t in b.equals]
        for first, second in zip(a.tried, b.tried, strict=True):
            assert first.rejected == second.rejected
            np.testing.assert_allclose(first.loss, second.loss, rtol=1e-9)


def test_fits_of_an_effects_rivals_share_the_derivatives_of_the_others(searched):
    """They are as long as the recordings, so a copy for each rival would take most of the memory."""
    search, state = searched
    others = replace(state)
    (fit,) = search.fits(
        [state.world.without(HIDDEN[1].effect, HIDDEN[1].where)], 0, columns=[state.derivatives([HIDDEN[1]])]
    )
    others.take(fit, search.judge.losses([fit.world])[0])
    proposed = [EffectInstance.of(name, "elbow", **start(name)) for name in ("joint_bias", "rotor_inertia")]
    columns = [others.derivatives() for _ in proposed]
    fits = search.fits([fit.world.add(e) for e in proposed], 0, columns=columns)
    assert all(np.shares_memory(f.columns[0], fit.jacobian) and f.columns[1].shape[1] == 1 for f in fits)


@pytest.mark.slow
def test_the_library_is_asked_in_the_joint_that_misses_most_unless_only_noise_is_left(searched):
    """Also of many effects, of which linear algebra alone proposes nothing here."""
    search, state = Asked(searched[0]), searched[1]
    joints = search.evidence.items[0].robot.joints
    worst = joints[int(np.argmax(joint_z(search.missing(state.world))))]
    tried = rivals.find_rivals(search, state, lambda text: None)
    for placed, rival in zip(state.world.effects, tried, strict=True):
        assert bool(rival.tried) == (placed.where in (worst, "all")), placed.label
    assert any(r.tried for r in tried)
    with varied(at_floor=np.inf):
        assert not any(r.tried for r in rivals.find_rivals(search, state, lambda text: None))


def test_signatures_beside_one_world_are_taken_once(searched):
    search, state = searched
    places = [("joint_bias", "elbow"), ("rotor_inertia", "shoulder")]
    missing = search.missing(state.world)
    first = search.signatures(state.world, state.residual, places[:1], missing)
    both = search.signatures(state.world, state.residual, places, missing)
    assert both[0] is first[0] and len(both) > 1
    assert [*map(id, search.signatures(state.world, state.residual, places, missing))] == [*map(id, both)]
    fewer = state.world.without("coulomb_friction", "elbow")
    other = search.evidence.residuals([fewer])[0]
    (beside,) = search.signatures(fewer, other, places[:1], missing)
    assert not np.allclose(beside.columns, first[0].columns), "another world, other signatures"
    again = search.signatures(state.world, state.residual, places[:1], missing)
    np.testing.assert_array_equal(again[0].columns, first[0].columns)


class Counted(Search):
    """A search that notes the places that it screens."""

    def __init__(self, like: Search):
        super().__init__(like.evidence, like.judge)
        self.places_screened: list[tuple[str, str]] = []

    def screened(self, world, residual, fit, places, missing, groups=(), several=False):
        """Note the places and screen them."""
        self.places_screened.extend(places)
        return super().screened(world, residual, fit, places, missing, groups, several)


def test_what_was_screened_beside_a_world_is_not_screened_again(searched):
    search = Counted(searched[0])
    bare = search.start(World(searched[1].world.robot))
    places, missing = [("joint_bias", "elbow"), ("rotor_inertia", "shoulder")], search.missing(bare.world)
    first = search.screened(bare.world, bare.residual, None, places[:1], missing)
    both = search.screened_alone(bare.world, bare.residual, None, places, missing)
    again = search.screened_alone(bare.world, bare.residual, None, places, missing)
    assert search.places_screened == places and again == both
    assert [s for s in both if s.key == places[0]] == first
    assert [s.gain for s in both] == sorted((s.gain for s in both), reverse=True)


def test_servos_are_asked_for_in_every_joint_at_once_each_with_its_best_guess():
    rng = stream(1, "servos")
    names, guesses = ("natural_frequency", "gain"), (10.0, 60.0)
    taken = [
        Signature(
            EffectInstance.of("servo", where, natural_frequency=w, gain=0.98), names, rng.standard_normal((400, 2))
        )
        for where in ("shoulder", "elbow")
        for w in guesses
    ]
    right = taken[1], taken[2]  # the fast shoulder, the slow elbow
    wanted = [0.9, 0.5], [0.8, 0.7]
    residual = sum(s.columns @ c for s, c in zip(right, wanted, strict=True)) + 0.1 * rng.standard_normal(400)
    group = [("servo", "shoulder"), ("servo", "elbow")]
    (found,) = screen(taken, residual, None, [], [group])
    assert found.label == "servo(each)"
    values = {e.where: {k: v.value for k, v in e.params.items()} for e in found.members}
    assert (values["shoulder"]["natural_frequency"], values["elbow"]["natural_frequency"]) == (60.0, 10.0)
    assert values["shoulder"]["gain"] == pytest.approx(1.0 - 0.02 * 0.5, abs=1e-3)
    columns = np.concatenate([s.columns for s in right], axis=1)
    left = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
    assert found.gain == pytest.approx(residual @ residual - left @ left)


def test_a_proposed_set_is_one_candidate_and_its_absent_effects_are_removed(recordings):
    """Values that are 10 % off and two effects too many: rollouts correct the values, and those two are not found."""
    off = [e.with_values(**{k: 1.1 * v.value for k, v in e.params.items()}) for e in HIDDEN]
    extra = [
        EffectInstance.of("joint_bias", "elbow", torque=0.05),
        EffectInstance.of("cable_spring", "shoulder", stiffness=0.05, reference=0.0),
    ]
    search = Search(Evidence(recordings[:2]), Judge(Evidence(recordings[2:])), proposed=lambda: [*extra, *off])
    state = search.start(World())
    assert search.move(state)
    (whole,) = [t for t in state.steps[0][1] if t.score.count == len(HIDDEN) + 2]
    assert not whole.rejected and whole.gain.relative > 0.99
    found = {e.label: e for e in state.world.effects}
    assert set(found) == {e.label for e in HIDDEN}
    for e in HIDDEN:
        (name,) = e.params
        assert found[e.label].params[name].value == pytest.approx(e.params[name].value, rel=0.02)


def test_a_proposed_set_that_explains_nothing_is_refused(recordings):
    wrong = [EffectInstance.of("joint_bias", j, torque=0.3) for j in ("shoulder", "elbow")]
    search = Search(Evidence(recordings[:2]), Judge(Evidence(recordings[2:])), proposed=lambda: wrong)
    state = search.start(World())
    assert search.move(state)
    assert {e.label for e in state.world.effects} == {e.label for e in HIDDEN}
