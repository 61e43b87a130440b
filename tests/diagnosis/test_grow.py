"""Friction that falls with speed stands behind dry friction where it leaves most of what that leaves, only there."""

from __future__ import annotations

import numpy as np
import pytest
from fits import evidence, fit, judge, lost
from loops import ARM, drive, recorded

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.diagnosis.findings import Gain, Score, Trial
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.law import _explains_more, grow
from vispeg.diagnosis.selection.search import Search
from vispeg.diagnosis.selection.state import State
from vispeg.identify.evidence import Evidence
from vispeg.robots.model import load
from vispeg.worlds.world import World

DRY = EffectInstance.of("coulomb_friction", "elbow", torque=0.3)
FALLING = EffectInstance.of("stribeck_friction", "elbow", coulomb=0.3, excess=0.25, velocity=0.08)


@pytest.mark.parametrize("hidden", [FALLING, DRY])
def test_friction_that_falls_with_speed_takes_the_place_of_dry_friction(hidden, tmp_path):
    """Its excess, which no interval of few reversals leaves out of null, is there by what it gains on held-out data."""
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    robot, recordings = load(path), []
    for i in range(3):
        t = np.arange(1000) * 5e-3
        swing = 1 - np.cos(2 * np.pi * np.outer(t, [0.5 + 0.1 * i, 0.4 - 0.05 * i]))
        s = drive(robot, "position", 0.0, command=0.3 * swing, seconds=5.0, rate=200.0, kp=60.0, kd=4.0)
        recordings.append(recorded(robot, robot.source, World().add(hidden), s, stream(5, i)))
    search = Search(Evidence(recordings[:2]), Judge(Evidence(recordings[2:])))
    state = search.start(World(robot.source).add(DRY), 0)
    before = search.judge.mean(state.loss)
    grow(search, state, DRY)
    (found,) = state.world.effects
    assert found.effect == hidden.effect
    if hidden is FALLING:
        assert search.judge.mean(state.loss) < 0.5 * before
        assert found.params["excess"].value == pytest.approx(0.25, rel=0.2)
        assert state.steps[-1][0].score.out[0].label == DRY.label


@pytest.mark.parametrize(
    ("left", "crossed", "alone", "stands"),
    [(10.0, 1.7, 2.0, True), (10.0, -0.8, 3.3, True), (10.0, 1.6, 2.3, False), (60.0, 9.0, 9.0, False)],
)
def test_what_contains_dry_friction_shows_cross_fitted_or_surely_on_held_out_recordings(left, crossed, alone, stands):
    """`left` of 100 noise variances; standard errors at which 5 and 1 % pass by chance are 1.64 and 2.33."""
    gain = Gain(100.0 - left, alone, 1.0 - left / 100.0)
    trial = Trial(Score(FALLING, 0.0, out=(DRY,)), fit(World().add(FALLING)), lost(left), gain)
    state = State(World().add(DRY), lost(100.0), np.zeros(1), 0)
    assert _explains_more(Search(evidence(), judge()), state, trial, crossed) == stands


def step(placed: EffectInstance, mean: float, *out: EffectInstance):
    """A step that added an effect, lowered the mean squared residual by `mean`, and removed the effects `out`."""
    return Trial(Score(placed, 0.0, out=out), fit(World().add(placed)), np.zeros(0), Gain(mean, 9.0, 0.5)), []


def test_an_exchange_for_a_slightly_better_effect_keeps_the_scale_of_gains():
    state = State(World(), np.zeros(0), np.zeros(0), 0, first=1011.0, steps=[step(DRY, 1000.0)])
    assert state.scale == pytest.approx(1000.0)
    state.steps.append(step(FALLING, 0.2, DRY))
    assert state.scale == pytest.approx(1000.1) and state.removed_by(FALLING) == pytest.approx(1000.2)


def test_the_gain_of_an_effect_includes_that_of_the_one_it_replaced():
    """Without end where two took turns: a step counts those before it alone."""
    state = State(World(), np.zeros(0), np.zeros(0), 0, first=101.0)
    state.steps = [step(DRY, 60.0), step(FALLING, 30.0, DRY)]
    assert (state.removed_by(DRY), state.removed_by(FALLING)) == (60.0, 90.0)
    state.steps.append(step(DRY, 1.0, FALLING))
    assert state.removed_by(DRY) == 91.0
    assert state.removed_by(EffectInstance.of("joint_bias", "elbow")) == 100.0, "one of the user's model: all of it"
