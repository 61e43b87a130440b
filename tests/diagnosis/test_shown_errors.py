"""Every figure of a page is of the same readings: an error in the record is what its plot shows."""

from __future__ import annotations

import numpy as np
import pytest
from loops import drive, pendulum, recorded

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
