#!/usr/bin/env python3
"""Compare the chosen windows of a long recording with as many evenly spread ones, and with its beginning.

    python scripts/bench/long_recording.py --table parquet --out long
    python scripts/bench/windows.py long

For each way of choosing, the table has the standard deviation of each parameter due to torque noise of 0.2 N m, for the
joint where it is largest.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from vispeg.recordings.checks.excitation import PARAMETERS, UNITS, excitation
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.load import load, needed
from vispeg.recordings.windows import LENGTH, SECONDS, choose

NOISE, CUTOFF_HZ = 0.2, 20.0


def main(folder: Path) -> None:
    """Print the table."""
    rec = load(folder, needed)
    chosen = choose(rec).chosen
    if chosen is None:
        sys.exit(f"{folder}: used whole")
    print(chosen.said(folder.name))
    length, count = round(LENGTH * rec.rate_hz), round(SECONDS / LENGTH)
    even = [np.arange(start, start + length) for start in np.linspace(0, len(rec.time) - length, count).astype(int)]
    ways = {
        "chosen": [np.flatnonzero((rec.time >= w.start) & (rec.time <= w.stop)) for w in chosen.windows],
        "evenly spread": even,
        "the beginning": [np.arange(count * length)],
    }
    print(f"{'':<16}" + "".join(f"{name:>14}" for name in PARAMETERS))
    print(f"{'':<16}" + "".join(f"{unit:>14}" for unit in UNITS))
    for way, windows in ways.items():
        sigmas = []
        for j in range(len(rec.joints)):
            parts = [smooth(rec.time[rows], rec.q[rows, j : j + 1], CUTOFF_HZ) for rows in windows]
            q, dq, ddq = (np.concatenate([part[k][:, 0] for part in parts]) for k in range(3))
            sigmas.append(list((excitation(q, dq, ddq, NOISE).sigma or {}).values()) or [np.inf] * len(PARAMETERS))
        print(f"{way:<16}" + "".join(f"{sigma:14.2g}" for sigma in np.max(sigmas, axis=0)))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
