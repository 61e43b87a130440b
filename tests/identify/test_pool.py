"""Jobs that share one batch: everybody's answers reach the right job, and failures reach the caller."""

from __future__ import annotations

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

    results = run_together([job(i, plan) for i, plan in enumerate(plans)], squares, most_rows=3)
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


def test_batches_are_no_larger_than_asked():
    sizes = []

    def evaluate(worlds):
        sizes.append(len(worlds))
        return squares(worlds)

    run_together([lambda submit: submit([world(float(i)) for i in range(10)])], evaluate, most_rows=4)
    assert sizes == [4, 4, 2]


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
