"""Jobs that share one batch: everybody's answers reach the right job, and failures reach the caller."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vispeg.core.effect import EffectInstance
from vispeg.identify.pool import run_together
from vispeg.worlds.world import World


def world(value: float) -> World:
    return World().add(EffectInstance.of("viscous_friction", "joint1", damping=value))


def value_of(w: World) -> float:
    return w.effects[0].params["damping"].value


def squares(worlds):
    return [np.array([value_of(w) ** 2]) for w in worlds]


@settings(max_examples=15)
@given(st.lists(st.lists(st.integers(1, 4), max_size=4), max_size=5))
def test_every_job_gets_its_own_answers(plans):
    """Jobs that ask for different numbers of worlds, different numbers of times, in any mix."""

    def job(i, plan):
        def run(submit):
            out = []
            for turn, size in enumerate(plan):
                asked = [float(100 * i + 10 * turn + k) for k in range(size)]
                out.append((asked, [float(r[0]) for r in submit([world(a) for a in asked])]))
            return i, out

        return run

    results = run_together([job(i, plan) for i, plan in enumerate(plans)], squares, at_once=24)
    assert [i for i, _ in results] == list(range(len(plans)))
    for _, turns in results:
        for asked, got in turns:
            np.testing.assert_allclose(got, np.square(asked))


def test_requests_are_merged_into_one_batch():
    sizes = []

    def evaluate(worlds):
        sizes.append(len(worlds))
        return squares(worlds)

    def job(submit):
        for _ in range(3):
            submit([world(1.0), world(2.0)])

    run_together([job] * 5, evaluate)
    assert sizes == [10, 10, 10]


def test_answers_wait_for_a_few_jobs_at_a_time_however_many_ask():
    """Twelve fits of five derivatives each: memory is that of a few requests, and each turn has answers for all."""
    long, turns = 100_000, []

    def evaluate(worlds):
        return [np.full(long, value_of(w)) for w in worlds]

    def job(submit):
        for _ in range(3):
            assert len(np.stack(submit([world(float(k)) for k in range(5)]), axis=1)) == long

    def peak(count):
        tracemalloc.start()
        run_together([job] * count, evaluate, turn=lambda: turns.append(count), length=long, at_once=12 * 8 * long)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    few, many = peak(2), peak(12)
    assert turns == [2] * 3 + [12] * 3
    assert many < 1.6 * few and many < 30 * 8 * long


def test_a_failing_job_is_raised_and_the_others_end():
    ended = []

    def fails(submit):
        submit([world(1.0)])
        raise KeyError("broken")

    def works(submit):
        for _ in range(3):
            submit([world(1.0)])
        ended.append(True)

    with pytest.raises(KeyError, match="broken"):
        run_together([works, fails, works], squares)
    assert ended == [True, True]


def test_a_failing_simulation_is_raised():
    def evaluate(worlds):
        raise ValueError("no simulation")

    with pytest.raises(ValueError, match="no simulation"):
        run_together([lambda submit: submit([world(1.0)])] * 2, evaluate)
