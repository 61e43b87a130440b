"""Fits of a pendulum's friction: the truth recovered, intervals that mean what they say, doubts that are said."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from loops import arm, drive, hinge, pendulum, recorded

import vispeg
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.diagnosis.compare import compare
from vispeg.identify.calibrate import calibrate
from vispeg.identify.checkpoint import Trace
from vispeg.identify.cmaes import minimise
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Chase, Race, fit_job
from vispeg.identify.inverse import evidence_for
from vispeg.identify.pool import run_together
from vispeg.report.fitted import fit_record
from vispeg.worlds.world import World

ROBOT = pendulum()
TRUTH = hinge("viscous_friction", damping=0.7).add(*hinge("coulomb_friction", torque=0.4).effects)
START = hinge("viscous_friction", damping=0.1).add(*hinge("coulomb_friction", torque=0.1).effects)


@lru_cache
def motion(pace: float = 1.0, seconds: float = 1.6, size: float = 1.0):
    """A soft servo on two sines that start at rest; `size` scales them."""
    time = np.arange(round(200 * seconds)) / 200.0
    parts = [(0.5 * size, 2 * np.pi * 0.8 * pace), (0.15 * size, 2 * np.pi * 2.1 * pace)]
    goal = sum(a * (1 - np.cos(w * time)) for a, w in parts)
    rate = sum(a * w * np.sin(w * time) for a, w in parts)
    gains = {"rate": 200.0, "kp": 40.0, "kd": 4.0}
    return drive(ROBOT, "position", command=goal[:, None], dq_cmd=rate[:, None], seconds=seconds, **gains)


def evidence(world: World, seed: int, segments=None) -> Evidence:
    segments = segments or [motion()]
    recordings = [
        recorded(ROBOT, ROBOT.source, world, s, stream(seed, i), h_max=2.5e-3) for i, s in enumerate(segments)
    ]
    return Evidence(recordings, h_max=2.5e-3)


def test_recordings_in_memory_are_told_apart_by_python_too():
    """Two of them are fitted; one given twice is refused, for its noise would count as new evidence."""
    first, second = (recorded(ROBOT, ROBOT.source, TRUTH, motion(), stream(7, i)) for i in range(2))
    (damping,) = vispeg.fit(ROBOT.source, [first, second], ["viscous_friction:hinge"]).effects
    assert damping.params["damping"].value > 0.3
    with pytest.raises(UserError, match="given twice"):
        vispeg.fit(ROBOT.source, [first, first], ["viscous_friction:hinge"])


@pytest.mark.parametrize(("option", "value"), [("method", "foo"), ("engine", "foo")])
def test_an_unknown_method_or_engine_is_refused(option, value):
    rec = recorded(ROBOT, ROBOT.source, TRUTH, motion(), stream(7, 0))
    with pytest.raises(UserError, match=f"{option}: no such choice; got .foo."):
        vispeg.fit(ROBOT.source, rec, "viscous_friction:hinge", **{option: value})


def test_a_place_of_its_own_beside_all_has_its_own_value():
    """In either order: elbow and shoulder have unlike friction, and each comes back."""
    robot = arm()
    shoulder, elbow = robot.joints
    truth = World(robot.source).add(
        EffectInstance.of("viscous_friction", shoulder, damping=0.8),
        EffectInstance.of("viscous_friction", elbow, damping=0.2),
    )
    time = np.arange(320) / 200.0
    goal = np.stack([0.5 * (1 - np.cos(5.0 * time)), 0.4 * (1 - np.cos(9.0 * time))], axis=1)
    swing = drive(robot, "position", command=goal, seconds=1.6, rate=200.0, kp=40.0, kd=4.0)
    rec = recorded(robot, robot.source, truth, swing, stream(7, "arm"))
    names = ["viscous_friction:all", f"viscous_friction:{elbow}"]
    for effects in (names, names[::-1]):
        found = {e.where: e.params["damping"].value for e in vispeg.fit(robot.source, rec, effects).effects}
        assert found == pytest.approx({"all": 0.8, elbow: 0.2}, abs=0.05)


def fit(ev: Evidence, start: World, free=None, **options):
    free = list(range(len(start.effects))) if free is None else free
    (result,) = run_together([fit_job(ev, start, free, iterations=20, **options)], ev.residuals)
    return result


def values(world: World) -> np.ndarray:
    return np.array([v.value for e in world.effects for v in e.params.values()])


def test_two_frictions_are_told_apart_and_recovered():
    result = fit(evidence(TRUTH, 0), START)
    np.testing.assert_allclose(values(result.world), [0.7, 0.4], atol=0.01)
    assert result.converged and not result.at_bound and not result.weak
    assert result.cost == pytest.approx(1.0, abs=0.1)
    assert abs(result.correlation[0, 1]) > 0.3 and result.correlation[0, 0] == pytest.approx(1.0)


def test_a_record_of_a_fit_has_the_error_that_a_comparison_of_its_model_has():
    """Both are means over the readings that are compared, here half of them, however far the model is off."""
    recordings = [recorded(ROBOT, ROBOT.source, TRUTH, motion(seconds=0.9), stream(5, "short"), h_max=1e-3)]
    ev = evidence_for(recordings)
    assert ev.count < 0.6 * ev.length
    found = calibrate(ev, hinge("viscous_friction", damping=0.1), [0], seed=0)
    record, world = fit_record(START, found, [0], ev, None)
    assert record["chi2"] > 100.0 and record["starts"][0]["chi2"] == record["chi2"]
    assert record["chi2"] == pytest.approx(compare(world, recordings).record["chi2"], rel=1e-6)


def test_a_fit_that_begins_where_another_ended_has_its_intervals():
    """What the model leaves is measured against the error without the fitted effects, not that of the model given."""
    ev = evidence(TRUTH, 0)
    found = calibrate(ev, hinge("coulomb_friction", torque=0.1), [0], seed=0)
    _, world = fit_record(START, found, [0], ev, None)
    _, again = fit_record(world, calibrate(ev, world, [0], seed=0), [0], ev, None)
    first, second = (w.effects[0].params["torque"] for w in (world, again))
    assert first.high is not None and first.high > 1.05 * first.value, "an effect is missing"
    assert (second.low, second.value, second.high) == pytest.approx((first.low, first.value, first.high), rel=0.02)


def test_a_fit_leaves_the_marks_of_a_diagnosis():
    """It changes values, and judges neither names nor what is left."""
    ev, viscous = evidence(TRUTH, 0), hinge("viscous_friction", damping=0.5)
    marked = replace(hinge("coulomb_friction", torque=0.3).effects[0], partial=True, tentative=True)
    found = calibrate(ev, viscous.add(marked), [0, 1], seed=0, iterations=2)
    record, world = fit_record(World().add(marked), found, [0, 1], ev, None)
    assert [(e.partial, e.tentative) for e in world.effects] == [(False, False), (True, True)]
    assert [(e.get("partial"), e.get("tentative")) for e in record["effects"]] == [(None, None), (True, True)]
    assert world.effects[1].origin != marked.origin


def test_misfit_widens_intervals_by_what_is_left_where_readings_are_compared():
    """Errors of three stated noises widen as a variance of nine would, also where readings are not compared."""
    bold = [replace(rec, noise={k: v / 3.0 for k, v in rec.noise.items()}) for rec in evidence(TRUTH, 0).recordings]
    ev = Evidence(bold, h_max=2.5e-3)
    result = fit(ev, START)
    variance = float(np.mean(result.residual[np.concatenate([i.valid.ravel() for i in ev.items])] ** 2))
    assert 5.0 < variance
    ordinary = np.diag(np.linalg.inv(result.jacobian.T @ result.jacobian))
    assert np.all(result.sigma**2 >= variance * ordinary * (1 - 1e-9))


def test_the_start_is_one_of_the_points_that_iterations_limits():
    """One point takes no step and still has intervals; two take one step, which comes nearer."""
    ev = evidence(TRUTH, 0)
    jobs = [fit_job(ev, START, [0, 1], iterations=n) for n in (1, 2)]
    none, one = run_together(jobs, ev.residuals)
    np.testing.assert_allclose(values(none.world), values(START), rtol=1e-12)
    assert (none.sigma > 0).all() and one.cost < none.cost


def test_stated_errors_are_those_of_repeated_experiments():
    """Over twenty noise draws: 95 % intervals hold the truth, standard errors match the scatter of the estimates."""
    fits = [fit(evidence(TRUTH, seed), TRUTH) for seed in range(20)]
    estimates = np.array([values(f.world) for f in fits])
    stated = np.array([[(v.high - v.low) / 2 for e in f.world.effects for v in e.params.values()] for f in fits])
    inside = np.abs(estimates - [0.7, 0.4]) <= stated
    assert inside.mean() > 0.85
    ratio = stated.mean(axis=0) / (1.96 * estimates.std(axis=0, ddof=1))
    assert ((ratio > 0.7) & (ratio < 2.5)).all(), ratio


def test_more_data_narrows_the_interval():
    short = fit(evidence(TRUTH, 1), START)
    long = fit(evidence(TRUTH, 1, [motion(pace) for pace in (0.8, 0.9, 1.0, 1.1)]), START)
    assert (long.sigma < 0.8 * short.sigma).all()


def test_errors_between_recordings_are_those_of_fits_that_leave_one_out():
    """An effect that differs between recordings: to first order, as refits to all recordings but one say."""
    dampings, paces = (0.5, 0.9, 0.6, 0.8), (0.8, 0.9, 1.0, 1.1)
    worlds = [
        hinge("viscous_friction", damping=d).add(*hinge("coulomb_friction", torque=0.4).effects) for d in dampings
    ]
    pairs = enumerate(zip(worlds, paces, strict=True))
    recordings = [recorded(ROBOT, ROBOT.source, w, motion(p), stream(9, i), h_max=2.5e-3) for i, (w, p) in pairs]
    together = fit(Evidence(recordings, h_max=2.5e-3), START)
    without = [fit(Evidence(recordings[:k] + recordings[k + 1 :], h_max=2.5e-3), START).u for k in range(4)]
    spread = np.sqrt(3 / 4 * np.sum((np.array(without) - np.mean(without, axis=0)) ** 2, axis=0))
    np.testing.assert_allclose(together.sigma, spread, rtol=0.15)


def test_a_recording_that_alone_tells_nothing_does_not_widen_intervals():
    """A joint that hardly moves does not determine its friction; three other recordings do as well with it."""
    segments = [motion(pace) for pace in (0.8, 0.9, 1.0)]
    alone = fit(evidence(TRUTH, 1, segments), START)
    beside = fit(evidence(TRUTH, 1, [*segments, motion(size=1e-3)]), START)
    assert (beside.sigma < 1.3 * alone.sigma).all()


def test_an_incomplete_model_says_so_in_its_cost_and_its_intervals():
    """Without the Coulomb term the fit is bad, and its interval is wider than noise alone would make it."""
    ev = evidence(TRUTH, 2)
    wrong = fit(ev, hinge("viscous_friction", damping=0.1))
    right = fit(evidence(hinge("viscous_friction", damping=0.7), 2), hinge("viscous_friction", damping=0.1))
    assert wrong.cost > 50 * right.cost
    assert wrong.sigma[0] > 5 * right.sigma[0]


def test_fixed_effects_keep_their_values():
    start = hinge("viscous_friction", damping=0.1).add(*hinge("coulomb_friction", torque=0.4).effects)
    result = fit(evidence(TRUTH, 3), start, free=[0])
    assert result.world.effects[1] == start.effects[1]
    assert values(result.world)[0] == pytest.approx(0.7, abs=0.01)


def test_what_the_data_do_not_show_is_named():
    """A tilt of gravity, where there is no gravity, leaves no trace."""
    robot = pendulum(0.0)
    s = motion()
    ev = Evidence([recorded(robot, robot.source, World(), s, stream(4))], h_max=2.5e-3)
    start = World().add(EffectInstance.of("gravity_tilt", "base", roll=0.01, pitch=0.01))
    result = fit(ev, start)
    assert set(result.weak) >= {"gravity_tilt(base).roll", "gravity_tilt(base).pitch"}
    roll = result.world.effects[0].params["roll"]
    assert roll.low == -0.35 and roll.high == 0.35  # all that is possible


def test_twins_are_named_together():
    """Coulomb friction and the Coulomb part of Stribeck friction are one quantity."""
    start = hinge("coulomb_friction", torque=0.2).add(EffectInstance.of("stribeck_friction", "hinge", coulomb=0.2))
    result = fit(evidence(TRUTH, 5), start)
    pair = [w for w in result.weak if "~" in w]
    assert any("coulomb_friction(hinge).torque" in w and "stribeck_friction(hinge).coulomb" in w for w in pair)


def test_a_value_at_its_bound_is_named():
    result = fit(evidence(hinge("torque_gain", gain=1.7), 6), hinge("torque_gain", gain=1.1))
    assert result.at_bound == ("torque_gain(hinge).gain",)
    assert values(result.world)[0] == pytest.approx(1.5, abs=1e-6)


def test_the_best_start_is_taken():
    """A start that diverges and one in the wrong basin do no harm beside a good one."""
    truth = hinge("cogging", amplitude=0.8, poles=15.0, phase=0.5)
    ev = evidence(truth, 7)
    lost = fit(ev, hinge("cogging", amplitude=0.3, poles=40.0))
    found = fit(
        ev, hinge("cogging", amplitude=0.3, poles=40.0), starts=[hinge("cogging", amplitude=0.5, poles=14.8, phase=0.6)]
    )
    np.testing.assert_allclose(values(found.world), [0.8, 15.0, 0.5], atol=0.05)
    assert lost.cost > 2 * found.cost


def test_global_search_needs_no_start_and_repeats():
    """CMA-ES comes to a yielding spring from far away; the same seed gives the same answer bit for bit."""
    ev = evidence(hinge("hysteresis", torque=0.8, stiffness=60.0), 8)
    start = hinge("hysteresis", torque=20.0, stiffness=2500.0)

    def search():
        job = fit_job(ev, start, [0], iterations=3, method="cma", rng=stream(1, "cma"))
        return values(run_together([job], ev.residuals)[0].world)

    first = search()
    np.testing.assert_allclose(first, [0.8, 60.0], rtol=0.05)
    np.testing.assert_array_equal(search(), first)
    with pytest.raises(ValueError, match="random generator"):
        run_together([fit_job(ev, start, [0], method="cma")], ev.residuals)


def test_a_fit_that_cannot_come_near_gives_up_and_one_that_can_is_the_same_as_alone():
    """Coulomb friction for viscous friction leaves most of the error, however long it is fitted."""
    ev, rollouts = evidence(hinge("viscous_friction", damping=0.7), 3), []

    def counted(worlds):
        rollouts.append(len(worlds))
        return ev.residuals(worlds)

    def cost(start: World, race: Chase | None):
        rollouts.clear()
        (result,) = run_together([fit_job(ev, start, [0], race=race)], counted)
        return result.cost, len(rollouts)

    wrong, right = hinge("coulomb_friction", torque=0.02), hinge("viscous_friction", damping=0.05)
    (best, steps), (alone, all_steps) = cost(right, None), cost(wrong, None)
    assert cost(right, Chase(1.3 * best)) == (best, steps)
    stopped, fewer = cost(wrong, Chase(1.3 * best))
    assert alone > 10 * best and stopped >= alone and fewer < all_steps


def test_a_chase_gives_up_by_the_rate_at_which_a_fit_falls():
    steep, flat = Chase(2.0), Chase(2.0)
    for lap in range(1, 7):
        steep.check(1.0 + 1e5 * 0.1**lap, lap)
    flat.check(361.0, 1)
    with pytest.raises(StopIteration):
        flat.check(355.0, 2)


@pytest.mark.parametrize("order", [(1.5, 30.0), (30.0, 1.5)])
def test_the_order_of_threads_decides_no_race(order):
    """Fits of one round go on whoever is told first; in the next round the one far behind gives up."""
    race = Race()
    for cost in order:
        race.check(cost, 2)
    race.turn()
    race.check(1.4, 3)
    with pytest.raises(StopIteration):
        race.check(29.0, 3)


def searched(costs, start, generations=5, trace=None):
    rng = np.random.default_rng(0)
    return minimise(costs, start, np.zeros(2), np.ones(2), sigma=0.2, generations=generations, rng=rng, trace=trace)


def test_a_start_that_is_best_comes_back_even_from_a_hole_that_no_population_meets():
    """A hole of 1e-6 about the start, also where it lies on the bounds; all else rises towards it."""
    for start in (np.array([0.1, 0.4]), np.array([0.0, 1.0])):

        def costs(points, at=start):
            return [0.0 if np.abs(x - at).max() < 1e-6 else 2.0 - float(np.linalg.norm(x - at)) for x in points]

        np.testing.assert_array_equal(searched(costs, start), start)


def test_a_better_point_is_taken_and_a_search_goes_on_where_it_stood():
    looked, truth = [], np.array([0.3, 0.6])

    def costs(points):
        looked.extend(points)
        return [float(np.sum((x - truth) ** 2)) for x in points]

    start, trace = np.array([0.9, 0.1]), Trace()
    best = searched(costs, start, 60, trace)
    np.testing.assert_allclose(best, truth, atol=1e-4)
    np.testing.assert_array_equal(looked[0], start)
    count = len(looked)
    half = Trace(generations=trace.generations[:30])
    np.testing.assert_array_equal(searched(costs, start, 60, half), best)
    assert len(looked) - count == sum(map(len, trace.generations[30:]))


@pytest.mark.parametrize("seed", range(5))
def test_one_parameter_alone_is_found_far_from_its_start(seed):
    def costs(points):
        return [float((x[0] - 0.7) ** 2) for x in points]

    low, high, rng = np.zeros(1), np.ones(1), np.random.default_rng(seed)
    found = minimise(costs, np.array([0.01]), low, high, sigma=0.2, generations=80, rng=rng)
    assert found[0] == pytest.approx(0.7, abs=1e-3)
