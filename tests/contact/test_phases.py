"""Blocks of a path, and the samples of a recording that they belong to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from straight import blocks

from vispeg.core.seeds import stream


def test_the_sample_of_a_block_is_the_one_with_the_least_difference_in_time():
    """Of an uneven clock, also before its first and after its last sample."""
    rng = stream(1, "nearest")
    clock = np.cumsum(rng.uniform(0.005, 0.02, 200))
    time = np.r_[0.0, clock[3] + 0.2 * (clock[4] - clock[3]), rng.uniform(0.0, clock[-1] + 0.1, 300)]
    found = replace(blocks(np.zeros(len(time), int)).phase, time=time).rows(clock)
    np.testing.assert_array_equal(found, np.argmin(np.abs(time[:, None] - clock), axis=1))
