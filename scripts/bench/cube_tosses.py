"""Diagnose real tosses of a cube, fitted to either half of them, in windows of 41 ms, 162 ms and whole tosses.

    python scripts/bench/cube_tosses.py DATA --out docs/results/cube_tosses.json

DATA holds `tosses.npz` of DAIRLab's ContactNets (BSD-3-Clause; it is not part of the project). Each half is fitted once
and judged on the other; the halves are the even and the odd tosses. The authors' own values: friction 0.18, restitution
0.125.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

RATE = 148.0  # Hz
CUBE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "tosses" / "cube.xml"
AUTHORS = {"friction": 0.18, "restitution": 0.125}


def halves(data: Path, most: int):
    """Return the even and the odd tosses, at most `most` of each."""
    from vispeg.recordings.importers.objects import import_object

    rec = import_object(data / "tosses.npz", "cube", RATE)
    for parity, name in enumerate(("even", "odd")):
        rows = np.flatnonzero((rec.episode % 2 == parity) & (rec.episode < 2 * most))
        arrays = {k: getattr(rec, k)[rows] for k in ("time", "pose", "rate", "episode")}
        yield replace(rec, path=Path(name), **arrays)


def main() -> int:
    """Fit each half and judge it on the other; print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder with tosses.npz")
    parser.add_argument("--tosses", type=int, default=285, help="of each half")
    parser.add_argument("--out", type=Path, default=None, help="JSON with both records' numbers")
    args = parser.parse_args()
    import vispeg
    from vispeg.core.errors import UserError

    try:
        even, odd = halves(args.data, args.tosses)
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    runs = []
    for fit, judge in ((even, odd), (odd, even)):
        begin = time.process_time()
        got = vispeg.diagnose(CUBE, fit, judge, threads=1, say=lambda text: print(text, file=sys.stderr))
        keys = ("verdict", "effects", "ladder", "noise_floor", "restarts", "contact", "notes", "candidates")
        record = {key: got.record[key] for key in keys}
        runs.append({"fitted": fit.name, "judged": judge.name, "tosses": len(fit.tosses), **record,
                     "cpu_s": round(time.process_time() - begin, 1)})  # fmt: skip
    print(table(runs))
    if args.out is not None:
        part = args.out.with_name(args.out.name + ".part")
        part.write_text(json.dumps({"authors": AUTHORS, "runs": runs}, indent=1) + "\n")
        part.replace(args.out)
    return 0


def table(runs: list[dict]) -> str:
    """Return both halves' values and errors as Markdown."""
    heads = (
        "window",
        "fitted on",
        "median error before → after",
        "RMS before → after",
        "parameter",
        "best",
        "95 %",
        "told",
    )
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for rows in zip(*(r["restarts"] for r in runs), strict=True):
        for run, row in zip(runs, rows, strict=True):
            error = [" → ".join(f"{1e3 * row[side][key]:.3g}" for side in ("before", "after")) + " mm"
                     for key in ("median_m", "rms_m")]  # fmt: skip
            for p in row["parameters"]:
                values = [f"{p[k]:.3g}" for k in ("best", "low", "high")]
                cells = (row["window"], run["fitted"], *error, p["parameter"], values[0], f"{values[1]} to {values[2]}")
                lines.append("| " + " | ".join((*cells, "yes" if p["told"] else "no")) + " |")
    for run in runs:
        c = ", ".join(f"{k} {v:.3g}" for k, v in run["contact"].items())
        lines.append(f"\n{run['fitted']}: {run['verdict']}; {c}; {run['cpu_s']:.0f} s of processor")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
