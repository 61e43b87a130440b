"""Choices among effects by linear algebra are what least squares gives; exchange undoes a wrong guess."""

from dataclasses import replace

import fits
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from vispeg.core.effect import EffectInstance, searchable
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.dictionary import Dictionary
from vispeg.diagnosis.evidence.signatures import Signature
from vispeg.diagnosis.findings import Gain, Rivals, Score, Trial
from vispeg.diagnosis.selection.names import Exchange, Ground, doubted, exchanges, never_named, tentative
from vispeg.diagnosis.selection.state import State
from vispeg.diagnosis.selection.together import exchanged, prior, together
from vispeg.identify.fit import Fit
from vispeg.identify.space import Space
from vispeg.worlds.world import World

N = 400
LEFT = {"": 0.05}  # squared residual, beyond the noise


def signature(effect: str, where: str, name: str, column: np.ndarray, value: float = 1.0) -> Signature:
    return Signature(EffectInstance.of(effect, where, **{name: value}), (name,), column[:, None])


def fitted(residual: np.ndarray, signatures: list[Signature], values: list[float]) -> Fit:
    """A fit of these effects at these values, whose derivatives are minus the columns."""
    effects = [s.probe.with_values(**{s.names[0]: v}) for s, v in zip(signatures, values, strict=True)]
    space = Space(World().add(*effects), range(len(effects)))
    jacobian = -np.concatenate([s.columns for s in signatures], axis=1) * [a.unit for a in space.axes]
    return fits.fit(space.world, residual=residual, jacobian=jacobian)


@pytest.fixture(scope="module")
def toy():
    """Four effects with columns of their own, of which a tilt looks like two biases and a bit."""
    rng = stream(2, "together")
    a, b, c, d = rng.standard_normal((4, N))
    tilt = 0.6 * a + 0.6 * b + 0.35 * c
    return {
        "a": signature("joint_bias", "joint1", "torque", a),
        "b": signature("joint_bias", "joint2", "torque", b),
        "friction": signature("coulomb_friction", "joint3", "torque", d),
        "tilt": signature("gravity_tilt", "base", "roll", tilt, value=0.01),
        "noise": 0.05 * rng.standard_normal(N),
    }


def test_losses_and_gains_are_those_of_least_squares(toy):
    y = 2.0 * toy["a"].columns[:, 0] - toy["friction"].columns[:, 0] + toy["noise"]
    fit = fitted(y - 1.5 * toy["a"].columns[:, 0], [toy["a"]], [1.5])
    dictionary = Dictionary(fit.residual, [toy["b"], toy["friction"], toy["tilt"]], fit)
    assert [e.key[0] for e in dictionary.entries] == ["joint_bias", "joint_bias", "coulomb_friction", "gravity_tilt"]
    columns = np.column_stack([toy[k].columns for k in ("a", "b", "friction", "tilt")])
    assert dictionary.total == pytest.approx(y @ y), "with nothing chosen, the residual is that of the bare model"
    for chosen in ([0], [0, 1], [0, 3], [1, 3]):
        left = y - columns[:, chosen] @ np.linalg.lstsq(columns[:, chosen], y, rcond=None)[0]
        assert dictionary.loss(chosen)[0] == pytest.approx(left @ left, rel=1e-6)
        gains = dictionary.gains(chosen)
        for k in {0, 1, 3} - set(chosen):
            more = dictionary.loss([*chosen, k])[0]
            assert gains[k] == pytest.approx(dictionary.loss(chosen)[0] - more, rel=1e-5, abs=1e-6)
    assert dictionary.placed([0, 1])[0].params["torque"].value == pytest.approx(0.02, abs=0.05), "of candidates alone"


def test_a_fold_is_predicted_by_the_coefficients_of_the_others(toy):
    """The slow oracle: leave each half out, fit the other, predict it."""
    y = 2.0 * toy["a"].columns[:, 0] - toy["tilt"].columns[:, 0] + 5 * toy["noise"]
    folds = [slice(0, N // 2), slice(N // 2, N)]
    dictionary = Dictionary(y, [toy["a"], toy["tilt"]], None, folds)
    columns, expected = np.column_stack([toy["a"].columns, toy["tilt"].columns]), 0.0
    for own, other in (folds, folds[::-1]):
        x = np.linalg.lstsq(columns[other], y[other], rcond=None)[0]
        expected += np.sum((y[own] - columns[own] @ x) ** 2)
    assert dictionary.crossed([0, 1]) == pytest.approx(expected, rel=1e-6) and expected > dictionary.loss([0, 1])[0]
    assert Dictionary(y, [toy["a"], toy["tilt"]], None).crossed([0]) == pytest.approx(dictionary.loss([0])[0])


def test_parameters_stay_within_their_bounds(toy):
    y = -toy["friction"].columns[:, 0] + 0.5 * toy["a"].columns[:, 0]
    dictionary = Dictionary(y, [toy["friction"], toy["a"]], None)
    columns = np.column_stack([toy["friction"].columns, toy["a"].columns])
    oracle = lsq_linear(columns, y, bounds=([0.0, -np.inf], [np.inf, np.inf]))
    loss, coefficients = dictionary.loss([0, 1])
    assert loss == pytest.approx(2 * oracle.cost, rel=1e-6)
    np.testing.assert_allclose(coefficients, oracle.x, atol=1e-6)


def test_an_early_wrong_guess_goes_out_when_what_it_stood_in_for_comes_in(toy):
    """Two biases were accepted for what is a tilt: it comes in for both."""
    y = 3.0 * toy["tilt"].columns[:, 0] + 2.0 * toy["friction"].columns[:, 0] + toy["noise"]
    biases = np.column_stack([toy["a"].columns, toy["b"].columns])
    x = np.linalg.lstsq(biases, y, rcond=None)[0]
    fit = fitted(y - biases @ x, [toy["a"], toy["b"]], x.tolist())
    proposal = together(Dictionary(fit.residual, [toy["friction"], toy["tilt"]], fit), most=8)
    assert isinstance(proposal, Score)
    assert {(e.effect, e.where) for e in proposal.members} == {("gravity_tilt", "base"), ("coulomb_friction", "joint3")}
    assert {e.where for e in proposal.out} == {"joint1", "joint2"}
    roll = next(e for e in proposal.members if e.effect == "gravity_tilt").params["roll"].value
    assert roll == pytest.approx(0.03, rel=0.1)


def test_an_exchange_names_what_explains_more_and_adds_nothing(toy):
    y = 2.0 * toy["b"].columns[:, 0] + toy["friction"].columns[:, 0] + toy["noise"]
    tilt = toy["tilt"].columns[:, 0]
    x = float(tilt @ y / (tilt @ tilt))
    wrong = fitted(y - x * tilt, [toy["tilt"]], [0.01 * x])
    score = exchanged(Dictionary(wrong.residual, [toy["a"], toy["b"], toy["friction"]], wrong))
    assert score is not None and not score.beside, "one for one, though the friction would lower the error further"
    assert [(score.placed.effect, score.placed.where)] == [("joint_bias", "joint2")]
    assert [(e.effect, e.where) for e in score.out] == [("gravity_tilt", "base")]
    b = toy["b"].columns[:, 0]
    right = fitted(y - 2.0 * b, [toy["b"]], [2.0])
    assert exchanged(Dictionary(right.residual, [toy["a"], toy["tilt"], toy["friction"]], right)) is None


def test_several_that_hardly_overlap_come_in_at_once_and_nothing_else(toy):
    y = 1.0 * toy["a"].columns[:, 0] + 0.7 * toy["friction"].columns[:, 0] + toy["noise"]
    candidates = [toy["a"], toy["b"], toy["friction"]]
    proposal = together(Dictionary(y, candidates, None), most=8)
    assert proposal is not None and not proposal.out and proposal.key[1] == "several"
    assert [e.label for e in proposal.members] == ["joint_bias(joint1)", "coulomb_friction(joint3)"]
    for e, value in zip(proposal.members, (1.0, 0.7), strict=True):
        assert e.params["torque"].value == pytest.approx(value, rel=0.05)
    only = toy["a"].columns[:, 0] + toy["noise"]
    assert together(Dictionary(only, candidates, None), most=8) is None, "one effect is a candidate already"


def test_aliases_are_not_named_and_certain_effects_are(toy):
    """Biases stand in for a tilt, friction is there: by exchange the tilt takes what a bias removes."""
    y = 3.0 * toy["tilt"].columns[:, 0] + 2.0 * toy["friction"].columns[:, 0] + toy["noise"]
    model = [toy["a"], toy["b"], toy["friction"]]
    columns = np.concatenate([s.columns for s in model], axis=1)
    x = np.linalg.lstsq(columns, y, rcond=None)[0]
    fit = fitted(y - columns @ x, model, x.tolist())
    ground = Ground(Dictionary(fit.residual, [toy["tilt"]], fit), LEFT)
    found = exchanges(ground, ground)
    said = {e.label: e for e in found}
    assert said["joint_bias(joint1)"].costs > RULES.name_costs, "without the tilt beside it, it looks needed"
    assert said["joint_bias(joint1)"].shaken == said["joint_bias(joint2)"].shaken == ("gravity_tilt(base)",)
    assert said["coulomb_friction(joint3)"].shaken == ()
    state = State(fit.world, np.zeros((1, 1)), fit.residual, 0)
    assert tentative(state, found, []) == {"joint_bias(joint1)", "joint_bias(joint2)"}


def test_far_from_the_recordings_only_what_removes_as_much_as_is_left_is_named(toy):
    fit = fitted(toy["noise"], [toy["a"], toy["b"]], [1.0, 1.0])
    state = State(fit.world, np.zeros((1, 1)), fit.residual, 0)
    much, little = Exchange("joint_bias(joint1)", 1.5, (), ()), Exchange("joint_bias(joint2)", 0.5, (), ())
    assert not tentative(state, [much, little], [])
    assert tentative(state, [much, little], [], far=True) == {"joint_bias(joint2)"}


def test_exchange_with_the_doubted_candidates_alone_is_that_with_all(toy):
    """Held-out signatures are taken of these alone: what looks like nothing in the model changes no answer."""
    rng = stream(6, "library")
    y = 3.0 * toy["tilt"].columns[:, 0] + 2.0 * toy["friction"].columns[:, 0] + toy["noise"]
    model = [toy["a"], toy["b"], toy["friction"]]
    columns = np.concatenate([s.columns for s in model], axis=1)
    x = np.linalg.lstsq(columns, y, rcond=None)[0]
    fit = fitted(y - columns @ x, model, x.tolist())
    near = 0.9 * toy["friction"].columns[:, 0] + 0.3 * rng.standard_normal(N)
    library = [signature("cogging", f"joint{k % 7 + 1}", "amplitude", rng.standard_normal(N)) for k in range(20)]
    library[5:5] = [toy["tilt"], signature("viscous_friction", "joint3", "damping", near)]
    held = [replace(s, columns=s.columns + 0.1 * rng.standard_normal(s.columns.shape)) for s in library]
    whole, whole_held = (Ground(Dictionary(fit.residual, some, fit), LEFT) for some in (library, held))
    few = [c - len(model) for c in doubted(whole)]
    assert {5, 6} <= set(few) and len(few) < len(library) / 2
    some, some_held = (Ground(Dictionary(fit.residual, [of[c] for c in few], fit), LEFT) for of in (library, held))
    for a, b in zip(exchanges(whole, whole_held), exchanges(some, some_held), strict=True):
        assert a.label == b.label and a.shaken == b.shaken and a.costs == pytest.approx(b.costs)
        assert [r.label for r in a.rivals] == [r.label for r in b.rivals]


def test_an_effect_is_named_together_with_its_proven_rivals(toy):
    """Of two columns that are nearly one, the effect is named with the other: one of."""
    near = toy["a"].columns[:, 0] + 1e-3 * toy["b"].columns[:, 0]
    y = toy["a"].columns[:, 0] + toy["noise"]
    fit = fitted(y - toy["a"].columns[:, 0], [toy["a"]], [1.0])
    other = signature("encoder_offset", "joint1", "offset", near, value=0.01)
    ground = Ground(Dictionary(fit.residual, [other], fit), LEFT)
    (own,) = exchanges(ground, ground)
    assert own.shaken == ("encoder_offset(joint1)",) and [r.label for r in own.rivals] == ["encoder_offset(joint1)"]
    state = State(fit.world, np.zeros((1, 1)), fit.residual, 0)
    rival = Trial(Score(other.probe, 0.0), fitted(y - near, [other], [0.01]), np.zeros((1, 1)), Gain(0.0, 0.0, 0.0))
    proven = Rivals("joint_bias(joint1)", (rival,), (rival,))
    lost = Rivals("joint_bias(joint1)", (), (rival,))
    assert tentative(state, [own], []) == {"joint_bias(joint1)"}, "a rival that was not tried may be the truth"
    assert not tentative(state, [own], [proven]), "named, with its rival"
    assert not tentative(state, [own], [lost]), "named alone: the rival was fitted and lost"


def test_a_name_must_win_where_nothing_was_fitted(toy):
    """What happens to fit one motion better than the truth, and is worse on another, is not named."""
    rng = stream(5, "held")
    truth, other = toy["a"], toy["b"]
    y = truth.columns[:, 0] + 0.3 * other.columns[:, 0]
    stand_in = signature("coulomb_friction", "joint1", "torque", y + 0.01 * rng.standard_normal(N))
    new = rng.standard_normal((3, N))  # another motion: the stand-in is half as like the truth there
    columns = [new[0], new[1], 0.5 * new[0] + 0.8 * new[2]]
    sources = (truth, other, stand_in)
    held = [signature(s.probe.effect, s.probe.where, s.names[0], c) for s, c in zip(sources, columns, strict=True)]
    fit, elsewhere = fitted(y - stand_in.columns[:, 0], [stand_in], [1.0]), fitted(new[0], [held[2]], [1.0])
    before = Ground(Dictionary(fit.residual, [truth], fit), LEFT)
    after = Ground(Dictionary(new[0] - columns[2], [held[0]], elsewhere), LEFT)
    (own,) = exchanges(before, before)
    assert own.costs > RULES.name_costs and not own.shaken and not own.rivals, "on what was fitted the stand-in stands"
    (own,) = exchanges(before, after)
    assert own.costs > RULES.name_costs and own.shaken == ("joint_bias(joint1)",)
    assert [r.label for r in own.rivals] == ["joint_bias(joint1)"], "and is to be fitted in its place"


def test_a_value_at_its_bound_is_no_name():
    """A gain of .5, as far as it goes, stands for something else; one of .9, or no friction left, does not."""
    at, inside = (EffectInstance.of("torque_gain", f"joint{k}", gain=g) for k, g in ((1, 0.5), (2, 0.9)))
    least = EffectInstance.of("coulomb_friction", "joint3", torque=1e-4)
    state = State(World().add(at, inside, least), np.zeros((1, 1)), np.zeros(1), 0)
    assert never_named(state) == {"torque_gain(joint1)"}
    assert not never_named(replace(state, n_fixed=1)), "what was given is not asked"


def test_every_bound_but_null_is_one_on_linear_and_on_logarithmic_scales():
    for name, kind in searchable().items():
        for m in kind.magnitudes:
            p = kind.params[m]
            ends = {p.low, p.high} - {p.null}
            between = np.sqrt(p.low * p.high) if p.scale == "log" else 0.3 * p.low + 0.7 * p.high
            for value, bound in [*((end, True) for end in ends), (float(between), False)]:
                placed = EffectInstance.of(name, "joint1", **{m: value})
                state = State(World().add(placed), np.zeros((1, 1)), np.zeros(1), 0)
                assert never_named(state) == ({placed.label} if bound else set()), (name, m, value)


def test_only_effects_that_grow_in_proportion_are_proposed():
    straight = {name for name, kind in searchable().items() if kind.straight}
    assert {
        "coulomb_friction",
        "viscous_friction",
        "rotor_inertia",
        "joint_bias",
        "payload",
        "gravity_tilt",
    } <= straight
    assert not {"backlash", "hysteresis", "stribeck_friction", "cogging", "torque_limit", "servo"} & straight
    for name, kind in searchable().items():
        assert set(kind.moments) <= {m for m, p in kind.params.items() if p.shape}, name


def test_a_value_at_its_bound_is_not_proposed():
    gain = Signature(EffectInstance.of("torque_gain", "joint1", gain=1.1), ("gain",), np.ones((N, 1)))
    low = (0.5 - 1.0) / 0.1
    assert gain.possible([1.0]) and gain.possible([-4.0]) and not gain.possible([low])
    probe = EffectInstance.of("payload", "flange", mass=0.5)
    mass = Signature(probe, ("mass",), np.ones((N, 4)), ("x", "y", "z"))
    assert mass.possible([1.0, 0.5, 0.0, 0.1])
    assert not mass.possible([0.01, 0.5, 0.0, 0.1]), "a moment without a mass is no payload"
    rotor = EffectInstance.of("rotor_inertia", "joint7", inertia=0.002)
    small = Signature(rotor, ("inertia",), np.ones((N, 1)))
    assert small.possible([1.0]) and not small.possible([-0.1]), "next to null, which is no bound, is a small wrist's"
    assert small.possible([2400.0]) and not small.possible([5.0 / 0.002])
    state = State(World().add(EffectInstance.of("torque_gain", "joint1", gain=0.5)), np.zeros((1, 1)), np.zeros(N), 0)
    assert tentative(state, [], []) == {"torque_gain(joint1)"}


@pytest.mark.parametrize("correlation", [0.5, -0.97])
def test_two_effects_that_cancel_are_both_tentative(toy, correlation):
    """A mass more here and a mass less there: each is dearly needed, beside the other."""
    fit = fitted(toy["noise"], [toy["a"], toy["b"]], [1.4, -1.4])
    fit = replace(fit, correlation=np.array([[1.0, correlation], [correlation, 1.0]]))
    world = fit.world
    state = State(world, np.zeros((1, 1)), fit.residual, 0, fit)
    assert (tentative(state, [], []) == {e.label for e in world.effects}) == (correlation < -0.9)


def test_a_link_must_earn_its_place_more_than_friction(toy):
    """A mass that removes 6 % of the error left does not come in beside others, friction that does, does."""
    y = 4.0 * toy["a"].columns[:, 0] + 0.5 * toy["b"].columns[:, 0] + 2.0 * toy["friction"].columns[:, 0]
    y = y + 40 * toy["noise"]
    mass = Signature(EffectInstance.of("link_mass", "link5", mass=1.0), ("mass",), toy["b"].columns)
    asked = [toy["a"], toy["friction"]]
    with_mass = together(Dictionary(y, [*asked, mass], None), most=8)
    with_bias = together(Dictionary(y, [*asked, toy["b"]], None), most=8)
    assert with_mass is not None and len(with_mass.members) == 2
    assert with_bias is not None and len(with_bias.members) == 3


def test_what_helps_one_fold_alone_is_not_proposed(toy):
    """A column that is up in one half and down in the other has no coefficient that serves both."""
    y = 3.0 * toy["a"].columns[:, 0] + toy["noise"]
    half = np.where(np.arange(N) < N // 2, 1.0, -1.0)
    turned = signature("joint_bias", "joint2", "torque", half * toy["a"].columns[:, 0])
    folds = [slice(0, N // 2), slice(N // 2, N)]
    assert together(Dictionary(y, [toy["a"], turned, toy["b"]], None, folds), most=8) is None
    alone = Dictionary(y, [turned], None, folds)
    assert alone.crossed([0]) > alone.total and together(alone, most=8) is None


def test_a_load_is_taken_in_the_place_of_a_links_centre_that_is_not_much_better(toy):
    """A load that promises 85 % of what the centre of the last link does; and one that promises 76 %."""
    rng = stream(5, "load")
    centre, other = rng.standard_normal((2, N))
    friction = toy["friction"]
    y = 2.0 * centre + 2.0 * friction.columns[:, 0] + toy["noise"]
    for share, taken in ((0.92, "payload"), (0.87, "link_com")):
        load = share * centre + np.sqrt(1 - share**2) * other
        signatures = [
            signature("link_com", "link7", "x", centre, 0.01), signature("payload", "flange", "mass", load), friction
        ]  # fmt: skip
        proposal = together(Dictionary(y, signatures, None), most=2)
        assert {e.effect for e in proposal.members} == {taken, "coulomb_friction"}


def test_effects_state_which_ones_are_likelier():
    """What an effect calls likelier is preferred to it; nothing else."""
    kinds = searchable()
    for a in kinds.values():
        for b in kinds.values():
            share = prior(EffectInstance.of(a.name, "joint4"), EffectInstance.of(b.name, "joint4"))
            assert np.isfinite(share) == (a.name in b.likelier), (a.name, b.name)
    assert [(b.name, b.likelier) for b in kinds.values() if b.likelier] == [
        ("link_com", ("payload",)), ("link_mass", ("payload",))
    ]  # fmt: skip
