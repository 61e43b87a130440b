"""Find readings that models are not compared with: angles that jump away and back, and repeats of an earlier one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.recordings.checks.spikes import spikes
from vispeg.recordings.checks.timing import held, within_episode
from vispeg.recordings.recording import Recording


def cleared(rec: Recording) -> Recording:
    """Return the recording without bad readings of its angles, and with its repeats marked; itself if there is none.

    A repeat is late: a log may be faster than its sensor, and hold each reading until the next. It stays in `q`, as
    another value would lie off the grid of a coarse encoder, and its noise would be taken for less.
    """
    if rec.bad is not None or rec.held is not None:  # done before
        return rec
    late, bad = held(rec.time, rec.q, within_episode(rec)), np.zeros(rec.q.shape, bool)
    fresh = np.flatnonzero(~late)
    for j, column in enumerate(rec.q[fresh].T):
        bad[[fresh[spike.row] for spike in spikes(rec.elapsed[fresh], column)], j] = True
    if not (late.any() or bad.any()):
        return rec
    q = np.where(bad, np.nan, rec.q)
    return replace(rec, q=q, bad=bad if bad.any() else None, held=late if late.any() else None)
