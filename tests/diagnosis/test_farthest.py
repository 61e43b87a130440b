"""A model is as far from the recordings as it is in the channel that it describes worst, over that channel's floor."""

from __future__ import annotations

import numpy as np
import pytest
from loops import iiwa_segment, recorded

from vispeg.core.seeds import stream
from vispeg.diagnosis.conclusion.farthest import farthest
from vispeg.diagnosis.conclusion.verdict import decide
from vispeg.identify.evidence import Evidence
from vispeg.robots.model import load
from vispeg.worlds.world import World


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    """Angles and joint torques of the iiwa."""
    rec = recorded(load("iiwa14"), "iiwa14", World(), iiwa_segment("position", 2.0, seed=1), stream(1, "farthest"))
    return Evidence([rec])


def off(evidence: Evidence, angle: float, torque: float) -> np.ndarray:
    """A residual of so many times the noise in each valid reading."""
    (item,) = evidence.items
    return np.where(item.valid, np.r_[np.full(7, angle), np.full(7, torque)], 0.0).ravel()


def test_the_channel_farthest_from_its_floor_counts(evidence):
    residual = off(evidence, 12.0, 1.0)
    assert residual @ residual / evidence.count == pytest.approx(72.5)
    assert farthest(evidence, residual) == pytest.approx(144.0)
    assert farthest(evidence, off(evidence, 1.0, 5.0)) == pytest.approx(25.0), "whichever it is"


def test_coarse_encoders_raise_the_floor_of_angles_alone(evidence):
    """Rounding leaves 9 noise variances in each angle, as a mean over angles and torques 5."""
    assert farthest(evidence, off(evidence, 3.0, 1.0), floor=5.0) == pytest.approx(1.0)
    assert farthest(evidence, off(evidence, 1.0, 3.0), floor=5.0) == pytest.approx(9.0)


def test_the_verdict_rests_on_the_farthest_channel_however_bad_the_nominal_model_was():
    assert decide(3000.0, 75.0, 9, [], []).verdict == "identified", "as a mean over all readings"
    verdict = decide(3000.0, 75.0, 9, [], [], farthest=149.0)
    assert verdict.verdict == "unexplained" and verdict.partial and "12 × its own noise floor" in verdict.reason
    assert decide(1e6, 75.0, 9, [], [], farthest=149.0).verdict == "unexplained"
    assert decide(3000.0, 34.0, 9, [], [], farthest=67.0).verdict == "identified"


def test_what_coarse_readings_leave_is_not_explained_by_any_effect():
    """Both models are 7 noise variances above the 3 that the right model leaves: nothing of the excess is explained."""
    nothing, half = (decide(10.0, after, 1, [], [], floor=3.0).unexplained for after in (10.0, 6.5))
    assert nothing["explained_share"] == 0.0 and half["explained_share"] == 0.5


def test_an_error_above_the_floor_is_not_laid_to_the_steps_of_the_encoders():
    steps = "is what its steps leave"
    assert steps in decide(9e4, 310.0, 1, [], [], floor=300.0, n_read=1).reason
    above = decide(9e4, 900.0, 1, [], [], floor=300.0, n_read=1)
    assert above.verdict == "identified" and steps not in above.reason and "fell from 300 to 30" in above.reason


def test_an_adequate_model_says_what_noise_leaves_of_the_right_one():
    said = decide(1872.0, 1872.0, 0, [], [], floor=28920.0)
    assert said.verdict == "adequate" and "readings leave 170 × the noise floor" in said.reason
    assert "no effect lowers it" not in said.reason, "none was asked"
    assert "no effect lowers it" in decide(1.4, 1.4, 0, [], []).reason
