"""Errors of a contact's form last as long as the contact: what one visit to a phase says of two worlds is one vote."""

from __future__ import annotations

import numpy as np
import pytest
from pressed import recorded

import vispeg
from vispeg.contact.run import evidence_of
from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.judge import Judge
from vispeg.recordings.load import load
from vispeg.worlds.world import World


def test_however_many_blocks_of_one_visit_agree_it_is_one_vote():
    judge = Judge(evidence_of([recorded(), recorded(turned=True)]))
    assert np.all(np.diff(judge.stretch) >= 0) and len(np.unique(judge.stretch)) > 6, "of both recordings, in order"
    longest = np.bincount(judge.stretch).argmax()
    within = (judge.stretch == longest)[:, None]
    assert within.sum() > 3
    after = judge.size.copy()
    assert judge.gain(after + 5.0 * within, after).z < 2.0
    assert judge.gain(after + 5.0, after).z > 2.0, "all visits say the same"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 8])
def test_presses_do_not_tell_a_heavier_tool_from_a_gain_of_the_sensor(seed, tmp_path):
    """Held upright, a tool weighs the same to both; where its tip sticks, errors may make the wrong one better."""
    mass, weighs = 0.3, 0.826
    heavier = EffectInstance.of("tool_mass", "gripper", mass=mass)
    gain = EffectInstance.of("wrench_gain", "flange", gain=1 + mass / weighs)
    vispeg.record("peg-cell", "press", effects=[heavier], noise={"ft": 0.1}, seed=seed).save(tmp_path / "press")
    judge = Judge(evidence_of([load(tmp_path / "press")]))
    before, right, wrong = judge.losses([World(), World().add(heavier), World().add(gain)])
    assert judge.mean(right) < 0.6 * judge.mean(before)
    better, worse = sorted((right, wrong), key=lambda loss: float(loss.sum()))
    assert equal(judge, worse, better, judge.mean(before), judge.evidence.alike, remaining=True)
