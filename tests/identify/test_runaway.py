"""Stretches in which a loop lost its arm say nothing: the rest of the recording is compared without them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from loops import iiwa_segment, recorded

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.identify.evidence import Evidence
from vispeg.identify.loops.runaway import said, without_runaway
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.model import load
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
SECONDS, LEAST = 3.0, 0.8
WORLD = World().add(EffectInstance.of("coulomb_friction", "joint4", torque=1.0))


@pytest.fixture(scope="module")
def calm() -> Recording:
    return recorded(ROBOT, "iiwa14", WORLD, iiwa_segment("position", SECONDS, seed=3), stream(3, "calm"))


def thrown(rec: Recording, begin: float, end: float) -> Recording:
    """Joint 5 is thrown about at up to 25 rad/s, which is eleven times what it is made for."""
    inside = (rec.time >= begin) & (rec.time <= end)
    q = rec.q.copy()
    q[inside, 4] += 0.4 * np.sin(2 * np.pi * 10.0 * (rec.time[inside] - begin))
    return replace(rec, q=q)


def mean_square(rec: Recording) -> float:
    evidence = Evidence([rec])
    (residual,) = evidence.residuals([WORLD])
    return float(residual @ residual) / evidence.count


def test_a_loop_that_holds_its_arm_keeps_all(calm):
    assert without_runaway(calm, ROBOT, LEAST) is calm


def test_what_comes_before_is_judged_as_if_nothing_followed(calm):
    """The right model stands at the floor up to there, and the stretch and what follows it are left out."""
    rec = thrown(calm, 2.0, 2.3)
    kept = without_runaway(rec, ROBOT, LEAST)
    assert kept.time[0] == 0.0 and kept.time[-1] == pytest.approx(2.0 - RULES.runaway_before, abs=0.02)
    assert without_runaway(kept, ROBOT, LEAST) is kept
    np.testing.assert_array_equal(kept.q, calm.q[: len(kept.q)])
    assert mean_square(rec) == pytest.approx(1.0, abs=0.2)
    (note,) = Evidence([rec]).notes
    assert "loses the arm" in note and "1.9 of 3 s" in note


def test_what_is_left_of_several_episodes_is_their_sum(calm):
    """The clock restarts with the second episode, of which all is left."""
    both = {k: np.concatenate([getattr(calm, k)] * 2) for k in ("time", "q", "tau", "q_cmd", "dq_cmd")}
    rec = replace(calm, episode=np.repeat([0, 1], len(calm.time)), **both)
    rec.q[: len(calm.time)] = thrown(calm, 2.0, 2.3).q
    assert "4.89 of 6 s can be compared" in said(rec, without_runaway(rec, ROBOT, LEAST))


def test_where_it_is_lost_at_once_what_follows_is_what_there_is(calm):
    kept = without_runaway(thrown(calm, 0.2, 0.5), ROBOT, LEAST)
    assert kept.time[0] == pytest.approx(0.5 + RULES.settle_observed, abs=0.02) and kept.time[-1] == calm.time[-1]


def test_nothing_is_left_out_where_nothing_would_be_left_or_known(calm):
    """A rated speed, a loop that could lose the arm, and time enough without it: else the recording stays whole."""
    rec = thrown(calm, 0.2, 2.9)
    assert without_runaway(rec, ROBOT, LEAST) is rec
    rec = thrown(calm, 2.0, 2.3)
    assert without_runaway(rec, replace(ROBOT, velocity_limit=np.full(7, np.inf)), LEAST) is rec
    passive = replace(rec, control=Control("passive", 500.0))
    assert without_runaway(passive, ROBOT, LEAST) is passive
