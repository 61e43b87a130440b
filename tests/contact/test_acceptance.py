"""What a diagnosis of contact accepts: units that favour no reading, floors, what is tried, what is left out again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pressed import recorded
from straight import Straight, search

from vispeg.contact.drive import Driven
from vispeg.contact.items import predicted
from vispeg.contact.phases import NAMES
from vispeg.contact.run import evidence_of
from vispeg.contact.selection.profile import outward, probed, tries
from vispeg.contact.selection.screen import Screen
from vispeg.contact.selection.search import ContactSearch
from vispeg.contact.selection.spare import may_be_absent, remove_uncertain, remove_unneeded
from vispeg.contact.sensor import true_per_read
from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.judge import Judge
from vispeg.worlds.world import World

FIXTURE = EffectInstance.of("fixture_compliance", "fixture", z=3e-5)
FRICTION = EffectInstance.of("contact_friction", "peg", scale=1.7)
CLEARANCE = EffectInstance.of("hole_clearance", "fixture")


def gain(value: float) -> World:
    return World().add(EffectInstance.of("wrench_gain", "flange", gain=value))


def test_the_noise_of_readings_leaves_the_same_residual_for_every_gain():
    """Noise read is noise told, whatever the gain."""
    item = evidence_of([recorded()]).items[0]
    n, gains = len(item.path.time), (1.0, 0.8, 1.25)
    read = stream(4, "gain").standard_normal((n, 6))
    told = Driven(np.stack([read / g for g in gains]), np.ones((3, 6)) / np.array(gains)[:, None], np.zeros((3, n, 6)))
    base, *others = predicted(item, told, [gain(g) for g in gains])
    assert np.std(base - item.measured) > 0.1
    for other in others:
        np.testing.assert_allclose(other, base, rtol=1e-9)


def test_a_newton_read_stands_for_as_much_as_the_gain_says():
    item = evidence_of([recorded()]).items[0]
    late = World().add(EffectInstance.of("wrench_delay", "flange", delay=0.02))
    biased = World().add(EffectInstance.of("wrench_bias", "flange", fx=1.0))
    for world, force in ((gain(1.25), 0.8), (late, 1.0), (biased, 1.0), (World(), 1.0)):
        assert true_per_read(item.path, world) == pytest.approx(force)


def test_the_floor_in_free_air_is_what_a_block_of_readings_leaves_of_their_noise():
    """White noise s over the n readings of a block: s / sqrt(n), beside the form's."""
    rec = recorded()
    item = evidence_of([rec]).items[0]
    free = item.phase.of("free") & item.phase.valid & ~item.phase.resting
    white = rec.noise["ft"] / np.sqrt(item.phase.size * item.path.step * rec.rate_hz)
    assert np.median(item.sigma[free][:, :3]) == pytest.approx(
        np.hypot(white, RULES.floor_form[NAMES.index("free")]), rel=0.2
    )


def offset_by(x: float) -> dict:
    """A residual that is a straight line in the hole's offset: x is hidden, y is felt, z hardly is."""
    felt = zip("xyz", 2e5 * np.eye(6) * np.array([1.0, 1.0, 0.015, 0, 0, 0]), strict=False)
    slopes = {("hole_offset", k): column for k, column in felt}
    return {"hidden": slopes["hole_offset", "x"] * x, "slopes": slopes}


def test_sizes_are_tried_from_none_outward_until_one_is_felt_and_none_promises():
    """Past what is hidden towards it, once away from it and where nothing is, to the end where nothing is felt."""
    probes = probed(Screen(Straight(**offset_by(2e-3)), World(), ()), [("hole_offset", "fixture")], 50.0)
    tried, names = [p.placed.params[p.name].value for p in probes], [p.name for p in probes]
    by = {k: sorted(v for n, v in zip(names, tried, strict=True) if n == k) for k in "xyz"}
    assert by == {"x": [-3e-4, 3e-4, 1e-3, 3e-3], "y": [-3e-4, 3e-4], "z": [-3e-3, -1e-3, -3e-4, 3e-4, 1e-3, 3e-3]}


def test_every_size_of_an_effect_lies_on_one_way_from_none():
    for name, where in (("contact_friction", "peg"), ("grip_pose", "peg"), ("wrench_delay", "flange")):
        ways = outward(name, where)
        assert sorted(p.label for way in ways for _, p in way) == sorted(p.label for _, p in tries(name, where))
        for way in ways:
            sizes = [abs(np.log(p.params[k].value)) if k == "scale" else abs(p.params[k].value) for k, p in way]
            assert sizes == sorted(sizes) and len({k for k, _ in way}) == 1


@pytest.mark.slow
def test_an_effect_that_is_not_needed_given_the_others_is_removed():
    """A fixture that gives way beside a hidden friction goes out, the friction stays."""
    evidence = evidence_of([recorded((FRICTION,))])
    evidence.absent = {("fixture_compliance", name) for name in ("x", "y", "roll", "pitch")}
    searching = ContactSearch(evidence, Judge(evidence_of([recorded((FRICTION,), 2)])))
    state = searching.start(World(), 0)
    (fit,) = searching.fits([World().add(FIXTURE).add(FRICTION)], 0, iterations=2)
    state.take(fit, searching.judge.losses([fit.world])[0])
    assert remove_unneeded(searching, state)
    assert [e.effect for e in state.world.effects] == ["contact_friction"]
    assert not remove_unneeded(searching, state), "the only one is not asked for"


def test_a_search_that_leaves_an_error_ends():
    """A fixture that gives way explains little of a friction; no move of joints, as an exchange, is tried on it."""
    evidence = evidence_of([recorded((FRICTION,))])
    evidence.absent = {("fixture_compliance", name) for name in ("x", "y", "roll", "pitch")}
    searching = ContactSearch(evidence, Judge(evidence_of([recorded((FRICTION,), 2)])))
    state = searching.start(World(), 0)
    (fit,) = searching.fits([World().add(FIXTURE)], 0, iterations=1)
    state.take(fit, searching.judge.losses([fit.world])[0])
    assert searching.judge.mean(state.loss) > RULES.at_floor * searching.judge.floor(state.world)
    assert any(way(state) for way in searching.ways(state)[1:]), "all but a further addition"
    assert state.concluded and not searching.move(state)


@pytest.mark.slow
def test_rivals_are_equal_within_what_chance_makes_of_lasting_errors():
    """One that is worse by less than a held-out confirmation, in all blocks alike, is as good; not one that explains
    a third; nor one that is worse by twice a confirmation.
    """
    judge = Judge(evidence_of([recorded(), recorded(turned=True)]))
    searching = ContactSearch(judge.evidence, judge)
    size, chance = judge.size, searching.confirms()

    def loss(total: float) -> np.ndarray:
        return size * total / size.sum()

    def alike(best: float, worse: float, without: float) -> bool:
        return equal(judge, loss(worse), loss(best), without / size.sum(), judge.evidence.alike)

    assert judge.gain(loss(900.0 + 0.9 * chance), loss(900.0)).z > 2.0, "by the ranks of visits they differ"
    assert alike(900.0, 900.0 + 0.9 * chance, 900.0 + 10 * chance)
    assert not alike(900.0, 900.0 + 0.9 * chance, 900.0 + 1.35 * chance)
    assert not alike(900.0, 900.0 + 2.0 * chance, 900.0 + 10 * chance)
    short = Judge(evidence_of([recorded()]))
    size, judge = short.size, short
    assert short.gain(loss(900.0 + 0.9 * chance), loss(900.0)).z < 2.0, "four visits are too few to differ"
    assert not alike(900.0, 900.0 + 0.9 * chance, 900.0 + 1.35 * chance)


def test_the_needed_gain_grows_with_the_residual_and_has_a_lower_bound():
    """Of errors as large as floors it asks what it asks at one variance; of smaller ones their share, lasting longer;
    of more its multiple; of none at all what chatter makes.
    """
    searching = ContactSearch(evidence_of([recorded()]), Judge(evidence_of([recorded((), 1)])))
    one, even = searching.need(1.0), searching.evidence.correlated / searching.evidence.lasting
    assert searching.need(even) == pytest.approx(one)
    assert searching.need(even / 2) == pytest.approx(one / 2)
    assert searching.need(3.0) == pytest.approx(3 * one)
    assert searching.confirms(even / 2) == pytest.approx(searching.confirms() / 2)
    asked = [searching.need(cost, count=2) for cost in np.linspace(0.0, 3.0, 31)]
    assert np.all(np.diff(asked) >= 0)
    assert asked[0] == searching.confirms(0.0) == 3 * searching.evidence.rough, "15 is the most that chatter makes"


@pytest.mark.parametrize(("left", "counted"), [(0.1, 0.1), (0.6, 0.6), (1.0, 1.0), (40.0, 1.0)])
def test_an_effect_is_screened_by_what_it_needs_beside_the_present_world(left, counted):
    """`left` variances of floors under a world: what is beyond floors may be what the effect takes away."""
    searching = search(Straight(np.full(402, np.sqrt(left)), {}))
    assert searching.needed_beside(World()) == pytest.approx(searching.need(counted))


def aside(x: float) -> EffectInstance:
    """A hole that stands aside by x, m."""
    return EffectInstance.of("hole_offset", "fixture", x=x)


def spanned(placed: EffectInstance, **spans: tuple[float, float]) -> EffectInstance:
    """An effect with these intervals."""
    values = {k: Value(placed.params[k].value, *span) for k, span in spans.items()}
    return replace(placed, params={**placed.params, **values})


@pytest.mark.parametrize(
    ("placed", "includes"),
    [
        (spanned(FIXTURE, z=(0.0, 6e-5)), True),
        (spanned(FIXTURE, z=(1e-5, 6e-5)), False),
        (spanned(FIXTURE, z=(0.0, 6e-5), x=(1e-6, 2e-6)), False),
        (spanned(FRICTION, scale=(0.9, 2.0)), True),
        (spanned(FRICTION, scale=(1.1, 2.0)), False),
        (spanned(aside(5.5e-4), x=(2e-4, 9e-4)), False),
        (spanned(aside(1.5e-4), x=(1e-4, 2e-4)), True),  # an arm does not repeat a place more closely
        (spanned(CLEARANCE, width=(0.5e-4, 2e-4)), False),  # a width is no pose
        (FIXTURE, False),
    ],
)
def test_an_effect_may_be_absent_where_the_intervals_of_all_fitted_magnitudes_include_null(placed, includes):
    assert may_be_absent(placed) == includes


@pytest.mark.slow
@pytest.mark.parametrize("others", [(), (FRICTION,)])
def test_an_effect_that_may_be_absent_is_removed(others):
    """Alone it leaves the model as it was given, beside another effect this one, fitted anew."""
    searching = ContactSearch(evidence_of([recorded((FRICTION,))]), Judge(evidence_of([recorded((FRICTION,), 2)])))
    world = World(effects=(*(spanned(e, scale=(1.6, 1.8)) for e in others), spanned(FIXTURE, z=(0.0, 6e-5))))
    state = searching.start(World(), 0)
    (fit,) = searching.fits([world], 0, iterations=1)
    state.take(replace(fit, world=world), state.loss)
    assert remove_uncertain(searching, state)
    assert [e.effect for e in state.world.effects] == [e.effect for e in others]
    (residual,) = searching.evidence.residuals([state.world])
    np.testing.assert_allclose(state.residual, residual, rtol=1e-6, atol=1e-9)
    assert (state.fit is None) == (not others)
