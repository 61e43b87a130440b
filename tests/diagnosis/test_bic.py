"""Whether an effect is worth its parameters: how many readings of a correlated residual are independent."""

from dataclasses import replace

import numpy as np
import pytest
from fits import still
from loops import pendulum

from vispeg.core.seeds import stream
from vispeg.diagnosis.selection.bic import correlation_time
from vispeg.identify.evidence import Evidence


def test_a_torque_that_is_never_read_leaves_angles_as_correlated_as_they_are():
    """White noise averaged over 20 readings has a correlation time of about 10; so it has beside an empty column."""
    rec = still(pendulum(), seconds=40.0)
    felt = replace(rec, tau=np.full_like(rec.q, np.nan), torque_sensor="joint", noise={"q": 2e-5, "tau": 0.1})
    angles, both = Evidence([rec]), Evidence([felt])
    noise = np.convolve(stream(1, "noise").standard_normal(angles.length), np.ones(20) / 20, "same")
    noise = np.where(angles.items[0].valid.ravel(), noise, 0.0)
    beside = np.column_stack([noise, np.zeros_like(noise)]).ravel()
    alone = correlation_time(angles, noise)
    assert alone == pytest.approx(10.0, rel=0.3)
    assert correlation_time(both, beside) == pytest.approx(alone, rel=1e-9)
