"""OSC recordings without any effect lie at their noise floor, though the null space forgets a wrong start slowly."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loop import GAINS, NULLSPACE, RATE, Run, simulate

from vispeg.core.seeds import stream
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import motion
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.noise import NOISE
from vispeg.recordings.recording import Control, Nullspace, Recording
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.worlds.world import World

ROBOT = load("iiwa14")


def times_floor(rec: Recording) -> float:
    """Error of the nominal model over the noise, both RMS."""
    evidence = Evidence([rec])
    return evidence.rms_error(evidence.residuals([World()])[0]) / evidence.floor


@pytest.fixture(scope="module")
def simulated():
    """Five seconds of OSC by `vispeg record`."""
    m = motion("osc", ROBOT, 500.0, 5.0, stream(1, "osc"), model=compiled(ROBOT))
    return record(World(), m, controller(ROBOT, "osc", 500.0, centre_of(ROBOT)), NOISE, stream(1, "noise"))


def test_from_rest(simulated):
    """A recording that begins at rest."""
    assert times_floor(simulated) < 1.1


@pytest.mark.parametrize("begin", [300, 777])
def test_from_the_middle_of_a_motion(simulated, begin):
    """The same cut in full motion: neither the posture nor its velocity is known but from noisy angles."""
    columns = {k: getattr(simulated, k)[begin:] for k in ("q", "dq", "tau", "ee", "ee_cmd")}
    cut = replace(simulated, time=simulated.time[begin:] - simulated.time[begin], **columns)
    assert np.abs(columns["dq"][0]).max() > 0.02
    assert times_floor(cut) < 1.5


def test_of_an_independent_plant():
    """Another implementation at 0.2 ms steps. Its sensor noise is added after the loop here: noise that is fed back
    really moves the arm, which no model of it can foresee."""
    m = motion("osc", ROBOT, RATE, 4.0, stream(5, "osc"), model=compiled(ROBOT), reach_m=0.12, turn_rad=0.35)
    signals = simulate([Run((), m, "osc", 0)], noise=False)[0]
    q = signals["q"] + stream(5, "noise").normal(scale=2e-5, size=signals["q"].shape)
    gains = (np.array(g) for g in GAINS["osc"])
    control = Control("osc", RATE, "model", *gains, Nullspace(*NULLSPACE))
    rec = Recording(
        Path("plant"), "iiwa14", ROBOT.joints, RATE, control, m.time, q, ee_cmd=signals["ee_cmd"], noise={"q": 2e-5}
    )
    assert times_floor(rec) < 1.2
