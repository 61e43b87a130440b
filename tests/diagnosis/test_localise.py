"""The missing torque of a hidden effect is the torque that it exerts, however torques are known."""

from dataclasses import replace

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.localise import joint_data, missing_torque
from vispeg.identify.excitation import motion
from vispeg.identify.inverse import evidence_for
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.recording import Control
from vispeg.robots.model import load
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
RIPPLE = {"amplitude": 4.0, "poles": 9.0, "phase": 0.7}


@pytest.fixture(scope="module")
def rippled():
    """A recording of an arm with cogging in joint 1, with its motors' torques."""
    truth = World().add(EffectInstance.of("cogging", "joint1", **RIPPLE))
    control = controller(ROBOT, "position", 500.0, centre_of(ROBOT))
    path = motion("fourier", ROBOT, 500.0, 4.0, stream(0, "ripple"))
    return record(truth, path, control, {"q": 2e-5, "tau": 0.2}, stream(1, "ripple"), torque_sensor="motor")


@pytest.mark.parametrize("known", [True, False], ids=["known controller", "measured torque"])
def test_the_missing_torque_is_that_of_the_hidden_effect(rippled, known):
    unknown = replace(rippled, control=Control("unknown", rippled.rate_hz), q_cmd=None, dq_cmd=None)
    evidence = evidence_for([rippled if known else unknown])
    missing = [missing_torque(i, y[0]) for i, y in zip(evidence.items, evidence.simulated([World()]), strict=True)]
    data = joint_data(missing, evidence.items)[0]
    exerted = RIPPLE["amplitude"] * np.sin(RIPPLE["poles"] * data.q + RIPPLE["phase"])
    assert exerted @ data.excess / (exerted @ exerted) == pytest.approx(1.0, abs=0.1)
    assert effect("cogging").guesses(data)[0]["phase"] == pytest.approx(RIPPLE["phase"], abs=0.3)
