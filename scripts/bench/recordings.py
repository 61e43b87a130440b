#!/usr/bin/env python3
"""Time and memory of reading long and many recordings.

    python scripts/bench/recordings.py --work bench

Makes recordings of 30 minutes at 1 kHz (CSV and Parquet), fifty of a minute, and one of 30 joints, by
`long_recording.py`, and runs `check`, `compare` and `convert` on them. CPU seconds count, as other work may run beside;
memory is the peak of one process.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent


def run(*command: str) -> tuple[float, float, float]:
    """Wall and CPU seconds and peak MB of a command. Raises RuntimeError where it fails."""
    start = time.monotonic()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    said = child.stderr.read() if child.stderr else b""
    _, status, used = os.wait4(child.pid, 0)
    if status:
        raise RuntimeError(f"{' '.join(command)}: {said.decode()[-300:]}")
    return time.monotonic() - start, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3


def made(folder: Path, **options: object) -> Path:
    """A recording, made unless it is there."""
    if not folder.exists():
        flags = [text for name, value in options.items() for text in (f"--{name}", str(value))]
        run(sys.executable, str(HERE / "long_recording.py"), "--out", str(folder), *flags)
    return folder


def main() -> int:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--only", default="", help="jobs whose line has this in it")
    args = parser.parse_args()
    work, vispeg = args.work, [sys.executable, "-m", "vispeg"]
    long = {kind: made(work / f"long-{kind}", minutes=args.minutes, table=kind) for kind in ("csv", "parquet")}
    many = [made(work / f"minute-{k}", minutes=1, seed=k, table="parquet") for k in range(50)]
    wide = {n: made(work / f"joints-{n}", minutes=1, joints=n, table="parquet") for n in (10, 30)}
    table = long["csv"] / "samples.csv"
    jobs = {
        "check, 30 min at 1 kHz, CSV": ["check", str(long["csv"])],
        "check, 30 min at 1 kHz, Parquet": ["check", str(long["parquet"])],
        "check --out, 30 min at 1 kHz": ["check", str(long["parquet"]), "--out", str(work / "c1"), "--overwrite"],
        "compare, 30 min at 1 kHz": ["compare", "iiwa14", "--recording", str(long["parquet"]),
                                     "--out", str(work / "c2"), "--overwrite"],
        "convert, 30 min at 1 kHz, CSV to Parquet": ["convert", str(table), "--robot", "iiwa14", "--table", "parquet",
                                                     "--out", str(work / "c3"), "--overwrite"],
        "convert --guess": ["convert", str(table), "--robot", "iiwa14", "--guess"],
    }  # fmt: skip
    jobs |= {f"check, {n} recordings of 1 min": ["check", *map(str, many[:n])] for n in (1, 10, 50)}
    jobs |= {f"check, 1 min of {n} joints": ["check", str(folder)] for n, folder in wide.items()}
    print(f"{'what':<42} {'wall s':>8} {'CPU s':>8} {'peak MB':>8}")
    for what, command in ((what, command) for what, command in jobs.items() if args.only in what):
        wall, cpu, peak = run(*vispeg, *command)
        print(f"{what:<42} {wall:8.1f} {cpu:8.1f} {peak:8.0f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
