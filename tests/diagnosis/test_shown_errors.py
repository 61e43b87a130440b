"""Every figure of a page is of the same readings: an error in the record is what its plot shows."""

from __future__ import annotations

import numpy as np
import pressed
import pytest
from loops import drive, pendulum, recorded

import vispeg
from vispeg.contact.phases import NAMES
from vispeg.core.assets import assets
from vispeg.core.seeds import stream
from vispeg.diagnosis.compare import compare
from vispeg.worlds.world import World


def test_the_error_of_the_headline_is_that_of_the_plot_and_of_the_table():
    robot = pendulum()
    t = np.arange(600) * 5e-3
    q = 0.4 * (1 - np.cos(2 * np.pi * 0.8 * t))[:, None]
    s = drive(robot, "position", q[0], command=q, seconds=3.0, rate=200.0, kp=60.0, kd=4.0)
    rec = recorded(robot, robot.source, World(), s, stream(3, 0))
    result = compare(World(robot.source), [rec])
    drawn = result.arrays["0/measured"] - result.arrays["0/before"]
    assert np.isnan(drawn[0]).all() and np.isfinite(drawn[-1]).all(), "the start is not compared"
    plain = np.sqrt(np.nanmean(drawn**2))
    assert result.record["ladder"][0]["heldout_error"] == pytest.approx(plain, rel=1e-9)
    assert result.record["joints"][0]["error"] == pytest.approx(plain, rel=1e-9)


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
