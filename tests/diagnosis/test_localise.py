"""The missing torque of a hidden effect is the torque that it exerts, however torques are known."""

from dataclasses import replace

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.localise import MissingTorque, cells, joint_data, maps, missing_torque, peaks, worst
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


def test_a_cell_of_load_holds_the_same_samples_before_and_after():
    """One of two joints misses ten noises at some loads, also under a second model that predicts 6 N m less there."""
    t = np.linspace(0.0, 10.0, 2000)
    q = np.repeat(np.sin(t)[:, None], 2, axis=1)
    load = 5.0 * q + [0.0, 5.0]
    excess = np.where((load > 4.6) & (load < 4.9), 10.0, 0.0) * [0.0, 1.0]
    before, after = ([MissingTorque(t, q, q, q, tau, tau, excess, np.ones(2))] for tau in (load, load - [0.0, 6.0]))
    rows = peaks(maps(before), ("shoulder", "elbow"), maps(after, over=before))
    for row in rows:
        assert row["times_noise"] == row["times_noise_after"] > 1.0, row["axis"]
    at, there = worst(after, over=before), cells(before)
    for axis, cell in there.items():  # the moment that a cell leads to lies in it
        for joint, numbers in enumerate(at[axis]):
            assert all(cell.number[row, joint] == k for k, row in enumerate(numbers) if row >= 0), axis
