"""Every figure of a page is of the same readings: an error in the record is what its plot shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pressed
import pytest
from loops import drive, pendulum, recorded

import vispeg
from vispeg.contact.phases import NAMES
from vispeg.core.assets import assets
from vispeg.core.seeds import stream
from vispeg.diagnosis.compare import compare
from vispeg.diagnosis.record import channels
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import TorqueEvidence
from vispeg.recordings.recording import Control
from vispeg.worlds.world import World


def swing(seconds: float = 3.0, seed: int = 0):
    """A pendulum that swings under position control, with its torque measured."""
    robot = pendulum()
    t = np.arange(round(200 * seconds)) * 5e-3
    q = 0.4 * (1 - np.cos(2 * np.pi * 0.8 * t))[:, None]
    s = drive(robot, "position", q[0], command=q, seconds=seconds, rate=200.0, kp=60.0, kd=4.0)
    return recorded(robot, robot.source, World(), s, stream(3, seed))


def test_the_error_of_the_headline_is_that_of_the_plot_and_of_the_table():
    rec = swing()
    result = compare(World(rec.robot), [rec])
    drawn = result.arrays["0/measured"] - result.arrays["0/before"]
    assert np.isnan(drawn[0]).all() and np.isfinite(drawn[-1]).all(), "the start is not compared"
    plain = np.sqrt(np.nanmean(drawn**2))
    assert result.record["ladder"][0]["heldout_error"] == pytest.approx(plain, rel=1e-9)
    assert result.record["joints"][0]["error"] == pytest.approx(plain, rel=1e-9)


def test_noise_of_torques_is_said_to_be_from_what_it_is_from():
    """Two runs of one motion tell it, whatever the recordings state."""
    runs = [replace(swing(6.0, k), control=Control("unknown", 200.0), q_cmd=None) for k in (0, 1)]
    floors = [compare(World(runs[0].robot), some).record["noise_floor"] for some in (runs[:1], runs)]
    assert [floor["from"] for floor in floors] == ["stated noise", "repeats"]
    assert floors[1]["value"] == TorqueEvidence(runs).floor != floors[0]["value"]


@pytest.mark.parametrize("first", [0, 1])
def test_a_torque_has_the_errors_of_the_recordings_that_have_one(first):
    """Angles are those of both recordings, torques of the one that was recorded with a sensor, in either order."""
    felt = swing()
    both = [felt, replace(felt, tau=None, torque_sensor="none")]
    together, alone = (Evidence(some) for some in ([both[first], both[1 - first]], [felt]))
    rows = [channels(e, e.simulated([World(felt.robot)]), None) for e in (together, alone)]
    assert [row["channel"] for row in rows[0]] == ["angle", "torque"]
    for mixed, one in zip(*rows, strict=True):
        assert mixed["unit"] == one["unit"] and mixed["floor"] == pytest.approx(one["floor"], rel=1e-12)
        assert mixed["before"] == pytest.approx(one["before"], rel=1e-12)
    (joint,) = compare(World(felt.robot), both).record["joints"]
    assert joint["error"] == pytest.approx(rows[1][0]["before"], rel=1e-9) and "torque_error" not in joint


def test_traces_of_a_result_leave_what_its_record_says():
    """Angles and torques, measured beside the model: the same errors as in the tables, with noise and unit."""
    result = vispeg.compare("iiwa14", assets() / "recordings" / "rig-c", seconds=3)
    angle, torque = result.traces
    assert (angle.channel, angle.unit, torque.channel, torque.unit) == ("angle", "rad", "torque", "N m")
    assert result.error == pytest.approx(np.sqrt(np.nanmean(angle.left**2)), rel=1e-9)
    for row, left, beside in zip(result.record["joints"], angle.left.T, torque.left.T, strict=True):
        assert row["error"] == pytest.approx(np.sqrt(np.nanmean(left**2)), rel=1e-9)
        assert row["torque_error"] == pytest.approx(np.sqrt(np.nanmean(beside**2)), rel=1e-9)
    assert angle.noise == pytest.approx(np.full(7, result.noise_floor)) and angle.regime is None


def test_traces_of_contact_have_their_phases():
    rec = pressed.recorded()
    result = vispeg.compare("peg-cell", rec)
    force, torque = result.traces
    assert (force.channel, force.unit, torque.channel, torque.unit) == ("force", "N", "moment", "N m")
    assert result.error == pytest.approx(np.sqrt(np.nanmean(force.left**2)), rel=1e-6)
    for row in result.record["phases"]:
        left = force.left[force.regime == NAMES.index(row["phase"])]
        assert row["before"] == pytest.approx(np.sqrt(np.nanmean(left**2)), rel=1e-6), row
