"""Where the search looks when the joints that lack most torque hold nothing it can name."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from loops import ARM, drive, recorded

import vispeg.diagnosis.selection.search as searching
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.signatures import at_bound
from vispeg.diagnosis.findings import Gain, Score, Trial
from vispeg.diagnosis.run import diagnose
from vispeg.diagnosis.selection import shadows
from vispeg.diagnosis.selection.accept import in_order, refusal
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.diagnosis.selection.shadows import cast_out, dismissed
from vispeg.diagnosis.selection.shown import Shown
from vispeg.diagnosis.selection.state import State
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit, fit_job
from vispeg.identify.pool import run_together
from vispeg.robots.model import load
from vispeg.worlds.world import World

FRICTION = EffectInstance.of("coulomb_friction", "shoulder", torque=0.8)
ELBOW = EffectInstance.of("encoder_offset", "elbow", offset=1e-6)
LAG = EffectInstance.of("actuator_lag", "shoulder", time_constant=1e-4)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A shoulder with dry friction, on three motions of both joints."""
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    robot, world, out = load(path), World().add(EffectInstance.of("coulomb_friction", "shoulder", torque=0.8)), []
    for i in range(3):
        t = np.arange(600) * 5e-3
        swing = 1 - np.cos(2 * np.pi * np.outer(t, [0.7 + 0.2 * i, 1.1 - 0.2 * i]))
        s = drive(robot, "position", 0.0, command=0.4 * swing, seconds=3.0, rate=200.0, kp=60.0, kd=4.0)
        out.append(recorded(robot, robot.source, world, s, stream(5, i)))
    return out


@pytest.mark.slow
@pytest.mark.parametrize("suspected", ["shoulder", "elbow"])
def test_joints_that_are_not_suspected_are_looked_at_before_the_search_gives_up(recordings, monkeypatch, suspected):
    monkeypatch.setattr(searching, "suspects", lambda lacks, joints: [suspected])
    world = World(recordings[0].robot)
    record = diagnose(world, recordings[:2], recordings[2:], nthread=1, plan_next=False).record
    assert [(e["effect"], e["where"]) for e in record["effects"]] == [("coulomb_friction", "shoulder")]
    refused = [(c["effect"], c["where"]) for c in record["candidates"]]
    assert refused and ("coulomb_friction", "shoulder") not in refused, "what was accepted was not refused"


def trial(label: str, loss: float, at_bound: bool = False, rejected: str = "") -> Trial:
    """A trial of one effect that left so much of 1000, each in 40 blocks of time."""
    start = EffectInstance.of(label, "elbow")
    (name,) = effect(label).magnitudes
    p = effect(label).params[name]
    placed = start.with_values(**{name: p.low if p.low != p.null else p.high}) if at_bound else start
    fit = SimpleNamespace(world=World().add(placed), space=SimpleNamespace(axes=()), correlation=np.zeros((0, 0)))
    gain = Gain(1000.0 - loss, 9.0, 1.0 - loss / 1000.0)
    return Trial(Score(placed, 1.0), fit, np.full((40, 1), 25.0 * loss), gain, rejected)  # type: ignore[arg-type]


def body(label: str, where: str, loss: float) -> Trial:
    """The same of an effect of bodies at its start."""
    placed = EffectInstance.of(label, where, **{k: p.start for k, p in effect(label).params.items()})
    named = trial("viscous_friction", loss)
    fit = SimpleNamespace(**{**vars(named.fit), "world": World().add(placed)})
    return replace(named, score=Score(placed, 1.0), fit=fit)  # type: ignore[arg-type]


def judge() -> Judge:
    evidence = SimpleNamespace(
        blocks=lambda seconds: np.repeat(np.arange(40), 25),
        items=[SimpleNamespace(nj=1, measured=np.zeros((1000, 1)), valid=np.ones((1000, 1), bool))],
        tells=lambda difference: np.ones(len(difference), bool),
        stretches=lambda blocks: np.arange(40),
        decisive=np.inf,
    )
    return Judge(evidence)  # type: ignore[arg-type]


def test_a_value_at_its_bound_stands_behind_whatever_else_passes():
    state = State(World(), np.full((40, 1), 25e3), np.zeros(1))
    friction, limit = trial("viscous_friction", 150.0), trial("torque_speed_limit", 90.0, at_bound=True)
    lost = trial(
        "rotor_inertia",
        50.0,
        rejected="it may be absent: its 95 % interval includes the value at which it does nothing",
    )
    names = [t.score.placed.effect for t in in_order(judge(), state, [lost, limit, friction])]
    assert names == ["viscous_friction", "torque_speed_limit", "rotor_inertia"]
    free = trial("torque_speed_limit", 90.0)
    assert in_order(judge(), state, [lost, free, friction])[0] is free, "a value inside its bounds wins by its error"
    assert in_order(judge(), state, [lost, limit])[0] is limit, "with nothing else it may come in, as a tentative one"
    gone = friction.fit.world.effects[0].with_values(damping=0.0)
    null = replace(friction, fit=SimpleNamespace(**{**vars(friction.fit), "world": World().add(gone)}))
    assert in_order(judge(), state, [limit, null])[0] is null, "null is no bound: a group's members may end there"


def test_of_equals_a_load_comes_before_the_centre_of_a_link_though_it_has_more_parameters():
    load, centre = body("payload", "flange", 151.0), body("link_com", "link7", 150.0)
    alone = State(World(), np.full((40, 1), 25e3), np.zeros(1))
    assert in_order(judge(), alone, [centre, load])[0] is centre, "one thing wrong with an arm may be a link as well"
    some = [body("payload", "flange", 301.0), body("link_com", "link7", 300.0)]
    assert in_order(judge(), alone, some)[0] is some[0], "where one leaves much, more is wrong"
    faint = State(World(), np.full((40, 1), 75.0), np.zeros(1))
    few = [replace(t, loss=np.full((40, 1), 25.0 + k / 100), gain=Gain(2.0, 9.0, 0.67)) for k, t in enumerate(some)]
    assert in_order(judge(), faint, few)[0] is few[1], "noise is nothing that one leaves"
    state = replace(alone, fit=load.fit)
    assert in_order(judge(), state, [centre, load])[0] is load
    mass = body("link_mass", "link7", 150.0)
    assert in_order(judge(), state, [mass, load])[0] is load
    other = body("servo", "joint4", 151.0)
    assert in_order(judge(), state, [other, centre])[0] is centre, "of others than the likelier one the least error"
    clear = body("link_com", "link7", 100.0)
    assert in_order(judge(), state, [clear, load])[0] is clear, "unless the data tell them apart"


@pytest.mark.parametrize(
    ("blocks", "drop", "holds"), [(15, 190.0, True), (15, 100.0, False), (14, 190.0, False), (18, 100.0, True)]
)
def test_a_large_gain_in_few_blocks_of_time_shows_in_held_out_recordings(blocks, drop, holds):
    """Some of 40 blocks gain, the others lose a little: 14, 15 and 18 are 0.8, 1.1 and 2.1 standard errors."""
    number = np.arange(40.0)
    before = np.where(number < blocks, 200.0, 100.0)
    after = before - np.where(number < blocks, drop + number / 100, -3.0 - number / 100)
    search = Shown()
    search.judge = judge()
    tried = replace(trial("viscous_friction", 100.0), loss=after[:, None])
    assert search.holds(State(World(), before[:, None], np.zeros(1)), tried) == holds


@pytest.mark.parametrize(
    ("name", "passes", "beside"),
    [
        ("cogging", True, "viscous_friction"),
        ("cable_spring", True, "viscous_friction"),
        ("load_friction", False, "viscous_friction"),
        ("cogging", False, "cable_spring"),
    ],
)
def test_what_removes_little_beside_friction_is_named_where_no_friction_can_remove_it(name, passes, beside):
    """2 % of what friction removed, 40 % of what is left: form of friction, or a torque of the angle."""
    state = State(World().add(EffectInstance.of(beside, "elbow")), np.full((40, 1), 25e3), np.zeros(1))
    state.removed_by = lambda placed: 2e4  # type: ignore[method-assign]
    search = SimpleNamespace(least_share=0.001, evidence=SimpleNamespace(least_gain=0.01), holds=lambda state, t: True)
    t = replace(trial(name, 600.0), gain=Gain(400.0, 9.0, 0.4))
    text = refusal(search, state, t, 3.0, True)  # type: ignore[arg-type]
    assert (
        text == "it may be absent: its 95 % interval includes the value at which it does nothing"
        if passes
        else text.startswith("only refines")
    )


@pytest.mark.parametrize(("at_bound", "remains"), [(True, 90.0), (False, 90.0), (False, 110.0), (False, 1.1)])
def test_several_are_tried_at_a_time_where_one_joint_comes_first_and_its_best_is_not_all_there_is(
    recordings, monkeypatch, at_bound, remains
):
    """A light wrist hides what others miss: its shadow is not taken for want of them, nor where much remains beside it.
    What leaves noise alone was all, and nothing else is tried."""
    monkeypatch.setattr(searching, "suspects", lambda lacks, joints: ["elbow"])
    monkeypatch.setattr(searching, "all_common", lambda *_: [])  # tests/diagnosis/test_pairs.py
    search, asked = Search(Evidence(recordings[:2]), Judge(Evidence(recordings[2:]))), []
    alone, rest = trial("torque_speed_limit", remains, at_bound), trial("coulomb_friction", 100.0)

    def step_at(state, n_fixed, places, missing, tested, common=(), several=False):
        asked.append((bool(places), {name for group in common for name, _ in group}, several))
        return [rest] if several else [alone]

    search.step_at = step_at  # type: ignore[method-assign]
    monkeypatch.setattr(searching, "in_order", lambda judged, state, trials: in_order(judge(), state, trials))
    first = search.step(State(World(recordings[0].robot), np.full((40, 1), 25e3), np.zeros(1)), 0)[0]
    assert first is (rest if at_bound or remains > 100.0 else alone)
    again = at_bound or remains > 2.0
    assert asked[0] == (True, set(), False)
    assert (len(asked) == 2) == again
    assert not again or (asked[1][0] is False and asked[1][2] and "coulomb_friction" in asked[1][1])
    asked.clear()
    begun = State(World(recordings[0].robot), np.full((40, 1), 25e3), np.zeros(1), fit=rest.fit)
    search.step(begun, 0)
    assert [several for *_, several in asked] == [True], "beside a fit, several are tried from the first"


def test_what_stands_at_a_bound_goes_where_the_search_gets_further_without_it(recordings):
    """A limit that was taken for friction: beside it the friction gains little, in its place all."""
    search = Search(Evidence(recordings[:2]), Judge(Evidence(recordings[2:], h_max=1e-3)))
    stall = effect("torque_speed_limit").params["stall"].low
    shadow = EffectInstance.of("torque_speed_limit", "shoulder", stall=stall, no_load=0.3)
    bare, friction = World(recordings[0].robot), EffectInstance.of("coulomb_friction", "shoulder", torque=0.8)
    search.fits = lambda worlds, n_fixed, **how: [held(search, w) for w in worlds]  # type: ignore[method-assign]
    state = search.start(bare.add(shadow), 0)
    shadowed = search.judge.mean(state.loss)
    assert at_bound(state.world.effects[0])

    def advance(other, n_fixed):
        assert other.world == bare
        fit = held(search, bare.add(friction))
        other.take(fit, search.judge.losses([fit.world])[0])
        return True

    search.advance = advance  # type: ignore[method-assign]
    assert cast_out(search, state, 0)
    assert [e.label for e in state.world.effects] == ["coulomb_friction(shoulder)"]
    assert search.judge.mean(state.loss) < 0.01 * shadowed
    before = state.world
    assert not cast_out(search, state, 0) and state.world == before, "nothing stands at a bound any more"


def test_what_stands_at_a_bound_stays_where_nothing_better_comes_in(recordings):
    search = Search(Evidence(recordings[:2]), Judge(Evidence(recordings[2:], h_max=1e-3)))
    shadow = EffectInstance.of("torque_gain", "shoulder", gain=effect("torque_gain").params["gain"].low)
    search.fits = lambda worlds, n_fixed, **how: [held(search, w) for w in worlds]  # type: ignore[method-assign]
    state = search.start(World(recordings[0].robot).add(shadow), 0)
    search.advance = lambda other, n_fixed: False  # type: ignore[method-assign]
    assert not cast_out(search, state, 0) and [e.effect for e in state.world.effects] == ["torque_gain"]


def without_what(recordings, monkeypatch):
    """A search whose fits move nothing and whose step brings in the friction; the worlds that it starts from."""
    search = Search(Evidence(recordings[:2]), Judge(Evidence(recordings[2:], h_max=1e-3)))
    tried = []

    def advance(other, n_fixed):
        tried.append(other.world)
        fit = held(search, other.world.add(FRICTION))
        other.take(fit, search.judge.losses([fit.world])[0])
        return True

    monkeypatch.setattr(search, "fits", lambda worlds, n_fixed, **how: [held(search, w) for w in worlds])
    monkeypatch.setattr(search, "advance", advance)
    return search, tried


def test_a_lag_of_one_joint_beside_one_of_all_goes_where_the_search_gets_further_without_it(recordings, monkeypatch):
    """A lag of one joint that was taken for its friction; with none of all joints beside it, it stays."""
    search, tried = without_what(recordings, monkeypatch)
    monkeypatch.setattr(shadows, "_uncommon", lambda *args: [])
    bare, every = World(recordings[0].robot), EffectInstance.of("command_delay", "all", delay=1e-4)
    assert not cast_out(search, search.start(bare.add(ELBOW, LAG), 0), 0) and not tried
    for fixed in (0, 1):
        state = search.start(bare.add(every, LAG), fixed)
        assert cast_out(search, state, fixed) and tried.pop() == bare.add(every)
        assert [e.label for e in state.world.effects] == ["command_delay(all)", "coulomb_friction(shoulder)"]


def test_where_much_is_left_the_joint_with_the_greatest_error_is_asked_again_for_what_every_arm_has(
    recordings, monkeypatch
):
    """A lag of the shoulder, whose dry friction is missing; what every arm has stays there, and what is elsewhere."""
    search, tried = without_what(recordings, monkeypatch)
    viscous = EffectInstance.of("viscous_friction", "shoulder", damping=1e-6)
    bare = World(recordings[0].robot)
    state = search.start(bare.add(ELBOW, viscous, LAG), 0)
    assert search.judge.mean(state.loss) > RULES.far
    assert cast_out(search, state, 0) and tried == [bare.add(ELBOW, viscous)]
    assert {e.label for e in state.world.effects} == {e.label for e in (ELBOW, viscous, FRICTION)}
    explained = search.start(bare.add(ELBOW, LAG, FRICTION), 0)
    assert search.judge.mean(explained.loss) < RULES.far and not cast_out(search, explained, 0)
    assert not cast_out(search, search.start(bare.add(LAG), 0), 0), "with nothing else a search begins so"


def test_the_same_is_cast_out_once(recordings, monkeypatch):
    search, _ = without_what(recordings, monkeypatch)
    monkeypatch.setattr(search, "advance", lambda other, n_fixed: bool(steps.append(other.world)))
    state, steps = search.start(World(recordings[0].robot).add(ELBOW, LAG), 0), []
    for _ in range(2):
        assert not cast_out(search, state, 0) and len(steps) == 1


def held(search: Search, world: World) -> Fit:
    """A fit that moved nothing."""
    job = fit_job(search.evidence, world, range(len(world.effects)), iterations=1)
    fit = run_together([job], search.evidence.residuals)[0]
    return replace(fit, world=world, residual=search.evidence.residuals([world])[0])


@pytest.mark.parametrize("worth", [True, False])
def test_a_member_of_a_group_at_its_bound_goes_at_once_if_the_others_are_worth_having(recordings, worth):
    search = Search(Evidence(recordings[:2]), Judge(Evidence(recordings[2:], h_max=1e-3)))
    bare = World(recordings[0].robot)
    gain = EffectInstance.of("torque_gain", "shoulder", gain=effect("torque_gain").params["gain"].low)
    other = EffectInstance.of("coulomb_friction", "shoulder" if worth else "elbow", torque=0.8)
    search.fits = lambda worlds, n_fixed, **how: [held(search, w) for w in worlds]  # type: ignore[method-assign]
    (before,) = search.judge.losses([bare])
    state = search.start(bare.add(gain, other), 0)
    score = Score(gain, 1.0, (other,))
    state.steps, state.last = [(replace(trial("torque_gain", 90.0), score=score), [])], [trial("cogging", 90.0)]
    dismissed(search, state, before, score, 0)
    assert [e.effect for e in state.world.effects] == ["coulomb_friction"] if worth else len(state.world.effects) == 2
    assert len(state.last) == (not worth) and len(state.steps) == 1


@pytest.mark.parametrize(("touch", "share"), [(5.0, 5.0 / 100.0), (500.0, 1.0)])
def test_a_promise_is_measured_on_what_the_fitted_recordings_show(touch, share):
    """A limit that one motion touches for a moment and the judge for seconds can promise no more than the moment."""
    search = Search.__new__(Search)
    search.evidence = SimpleNamespace(least_gain=0.02, count=1000)  # type: ignore[assignment]
    search.judge, search.least_share = judge(), 0.001
    loss = np.full((40, 1), 25.0 * 100.0)
    state = State(World(), loss, np.full(1000, np.sqrt(touch)), first=100.0)
    assert search.judge.mean(loss) == pytest.approx(100.0)
    assert search.least_drop(state) == pytest.approx(0.02 * 100.0 * share)
