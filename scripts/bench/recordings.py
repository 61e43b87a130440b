#!/usr/bin/env python3
"""Time and memory of reading long and many recordings.

    python scripts/bench/recordings.py --work bench

Makes recordings of 30 minutes at 1 kHz (CSV and Parquet), fifty of a minute, and one of 30 joints, by
`long_recording.py`, and runs `check`, `compare`, `convert` and `diagnose` on them. CPU seconds count, as other work may
run beside; memory is the peak of one process.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent


def run(*command: str) -> tuple[float, float, float]:
    """Run a command; return its wall and CPU seconds and peak MB. Raises RuntimeError if it fails."""
    start = time.monotonic()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    said = child.stderr.read() if child.stderr else b""
    _, status, used = os.wait4(child.pid, 0)
    if status:
        raise RuntimeError(f"{' '.join(command)}: {said.decode()[-300:]}")
    return time.monotonic() - start, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3


def made(folder: Path, **options: object) -> Path:
    """Return the folder of a recording, which is made first if it does not exist."""
    if not folder.exists():
        flags = [text for name, value in options.items() for text in (f"--{name}", str(value))]
        run(sys.executable, str(HERE / "long_recording.py"), "--out", str(folder), *flags)
    return folder


def main() -> int:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--only", default="", help="jobs whose line has this in it")
    args = parser.parse_args()
    work, vispeg = args.work, [sys.executable, "-m", "vispeg"]

    def long(kind: str) -> str:
        return str(made(work / f"long-{kind}", minutes=args.minutes, table=kind))

    def many(n: int) -> list[str]:
        return [str(made(work / f"minute-{k}", minutes=1, seed=k, table="parquet")) for k in range(n)]

    def wide(n: int) -> str:
        return str(made(work / f"joints-{n}", minutes=1, joints=n, table="parquet"))

    def out(name: str) -> list[str]:
        return ["--out", str(work / name), "--overwrite"]

    iiwa, told = ["--robot", "iiwa14"], f"{args.minutes:g} min at 1 kHz"
    jobs: dict[str, Callable[[], list[str]]] = {
        f"check, {told}, CSV": lambda: ["check", long("csv")],
        f"check, {told}, Parquet": lambda: ["check", long("parquet")],
        f"check --out, {told}": lambda: ["check", long("parquet"), *out("c1")],
        f"compare, {told}": lambda: ["compare", "iiwa14", "--recording", long("parquet"), *out("c2")],
        f"convert, {told}, CSV to Parquet": lambda: [
            "convert", f"{long('csv')}/samples.csv", *iiwa, "--table", "parquet", *out("c3"),
        ],
        "convert --guess": lambda: ["convert", f"{long('csv')}/samples.csv", *iiwa, "--guess"],
        f"diagnose, {told}": lambda: [
            "diagnose", "iiwa14", "--recording", long("parquet"), "--validate", *many(1), *out("c4"),
        ],
    }  # fmt: skip
    jobs |= {f"check, {n} recordings of 1 min": lambda n=n: ["check", *many(n)] for n in (1, 10, 50)}
    jobs |= {f"check, 1 min of {n} joints": lambda n=n: ["check", wide(n)] for n in (10, 30)}
    print(f"{'what':<42} {'wall s':>8} {'CPU s':>8} {'peak MB':>8}")
    for what, command in ((what, command) for what, command in jobs.items() if args.only in what):
        wall, cpu, peak = run(*vispeg, *command())
        print(f"{what:<42} {wall:8.1f} {cpu:8.1f} {peak:8.0f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
