"""Hidden-camera benchmark: what does a diagnosis of pictures name in cells that hide something from it?

    python scripts/bench/hidden_camera --list
    python scripts/bench/hidden_camera --limit 16 --results rows.jsonl --out table.md
    python scripts/bench/hidden_camera --dev --only "focal_error/*" --results dev.jsonl

Pictures come from another renderer than the predictor's if one is installed (`--renderer filament`), in looks that the
predictor does not know, through a sensor that the library lacks. `--dev` uses seeds that are never scored, for tuning.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "hidden_effects"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from everywhere import ENGINES, each


def main() -> int:
    """Make, diagnose and score the chosen cases."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", default=[], metavar="PATTERN", help="case names or patterns of them")
    parser.add_argument("--limit", type=int, default=None, help="at most so many cases, spread evenly over the list")
    parser.add_argument("--dev", action="store_true", help="development seeds, not the scored ones")
    parser.add_argument("--first", type=int, default=0, help="seed of the first case, for a draw that nobody has seen")
    parser.add_argument("--list", action="store_true", help="print the chosen cases and stop")
    parser.add_argument("--frames", type=int, default=20, help="pictures of each of the two recordings")
    parser.add_argument("--renderer", default="filament", help="of the plant's pictures: filament, classic or raycast")
    parser.add_argument("--engine", choices=ENGINES, default="local", help="this process, or a Ray cluster")
    parser.add_argument("--workers", type=int, default=1, help="diagnoses at a time, on a cluster")
    parser.add_argument("--results", type=Path, default=None, help="JSON lines; cases that are there are not run again")
    parser.add_argument("--out", type=Path, default=None, help="also write the table, as Markdown")
    args = parser.parse_args()
    from cases import choose

    chosen = choose(args.only, 1000 if args.dev else args.first, args.limit)
    if args.list:
        print("\n".join(c.name for c in chosen))
        return 0
    from score import table

    lines = args.results.read_text().splitlines() if args.results and args.results.exists() else []
    rows = [json.loads(line) for line in lines]
    there = {r["case"] for r in rows}
    missing = [case for case in chosen if case.name not in there]
    work, several = partial(diagnosed, args.frames, args.renderer), args.workers if args.engine == "ray" else 1
    for _, row in each(work, missing, several, args.engine):
        rows.append(row)
        print(json.dumps(row), flush=True)
        if args.results:
            with args.results.open("a") as file:
                file.write(json.dumps(row) + "\n")
    text = table(rows)
    print(text)
    if args.out:
        args.out.write_text(text)
    return 0


def diagnosed(frames: int, renderer: str, case: Any) -> dict[str, Any]:
    """Make, diagnose and score one case."""
    from plant import CELL, recording
    from score import judged

    from vispeg.channels.channel import CHANNELS, How
    from vispeg.core.effect import REGISTRY

    null = {f"{n}.{k}": p.null for n, e in REGISTRY.items() for k, p in e.params.items()}
    parts = [recording(case, k, frames, renderer) for k in (0, 1)]
    start = time.process_time()
    record = CHANNELS["pictures"].diagnose(CELL, (parts[:1], parts[1:]), How()).record
    ends = [record["ladder"][k]["heldout_error"] for k in (0, -1)]
    result = {k: record[k] for k in ("verdict", "effects", "reason")} | {"before": ends[0], "after": ends[1]}
    result |= {"null": null, "not_excited": record["views"]["not_excited"]}
    return judged(case, result | {"cpu": time.process_time() - start})


if __name__ == "__main__":
    raise SystemExit(main())
