"""Motions from tables of people."""

import numpy as np
import pytest
from loops import pendulum

from vispeg.core.errors import UserError
from vispeg.identify.motions.replay import replay


def table(folder, unit: float = 1.0, gap: bool = False):
    """A swing of 2 s at 100 Hz with its rates; `unit` is that of its clock, s."""
    time = np.arange(200) * 0.01
    rows = np.column_stack([time / unit, 0.3 * np.sin(time), 0.3 * np.cos(time)]).astype(str)
    if gap:
        rows[50, 2] = ""
    file = folder / "motion.csv"
    file.write_text("\n".join(["time,q_cmd.hinge,dq_cmd.hinge", *(",".join(row) for row in rows)]))
    return file


@pytest.mark.parametrize("rate", [100.0, 250.0])
def test_a_gap_in_the_rates_is_refused(tmp_path, rate):
    assert np.isfinite(replay(table(tmp_path), pendulum(), rate).dq_cmd).all()
    with pytest.raises(UserError, match="dq_cmd: empty cells"):
        replay(table(tmp_path, gap=True), pendulum(), rate)


def test_a_clock_in_nanoseconds_is_refused(tmp_path):
    with pytest.raises(UserError, match="too long a motion.*1000000 samples"):
        replay(table(tmp_path, unit=1e-9), pendulum(), 100.0)
