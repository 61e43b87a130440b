"""Measure the influence of each rule of a diagnosis (docs/rules.md), by development cases with other values of it.

    python scripts/bench/rules.py --make DIR --rules tie=0 name_costs --cases "coulomb_friction/joint4/*" --limit 2

A rule without a value is halved and doubled. Every case also runs with the rules as they are. Each run is appended to
`--results` (JSON lines) as it ends; what is there of this commit, unchanged, is not run again. The scored seed is
refused.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parent / "hidden_effects"))

from cases import DEV, SCORED, Case, choose
from make import folders, make
from runner import commit

from vispeg.core.errors import UserError
from vispeg.core.rules import RULES, varied
from vispeg.diagnosis.run import diagnose
from vispeg.recordings.load import load
from vispeg.worlds.world import World

Value = float | tuple[float, ...]


def trials(asked: list[str]) -> list[dict[str, Value]]:
    """Return the sets of changed values to try: first none; then VALUE for `NAME=VALUE`, half and double for `NAME`."""
    out: list[dict[str, Value]] = [{}]
    for text in asked:
        name, _, given = text.partition("=")
        now = getattr(RULES, name, None)
        if now is None:
            raise UserError("no such rule", key=name, expected="a name of docs/rules.md")
        try:
            values = [tuple(map(float, given.split(","))) if "," in given else float(given)] if given else []
        except ValueError:
            raise UserError("no number", key=name, got=given) from None
        for value in values or [_times(now, 0.5), _times(now, 2.0)]:
            out.append({name: int(value) if isinstance(now, int) and not isinstance(value, tuple) else value})
    return out


def _times(value: Value, factor: float) -> Value:
    if isinstance(value, tuple):
        return tuple(factor * v for v in value)
    return max(1, round(factor * value)) if isinstance(value, int) else factor * value


def run(root: Path, case: Case, values: dict[str, Value]) -> dict:
    """Diagnose a case with these values; return the results."""
    first, second, last = (load(folder) for folder in folders(root, case))
    start = time.process_time()
    with varied(**values):
        record = diagnose(World(), [first, second], [last], nthread=1, plan_next=False).record
    names = [f"{e['effect']}({e['where']})" + ("?" if e.get("tentative") else "") for e in record["effects"]]
    rivals = [f"{r['effect']}({r['where']})" for e in record["effects"] for r in e["indistinguishable_from"]]
    error = float(record["ladder"][-1]["heldout_error"] or "nan") / record["noise_floor"]["value"]
    found = {
        "verdict": record["verdict"],
        "names": sorted(names),
        "rivals": sorted(rivals),
        "error": float(f"{error:.4g}"),
    }
    return found | {"seconds": round(time.process_time() - start, 1)}


def difference(base: dict, other: dict) -> str:
    """Return in words which results changed, and the processor time."""
    changed = [
        f"{key} {base[key]} > {other[key]}"
        for key in ("verdict", "names", "rivals", "error")
        if base[key] != other[key]
    ]
    return f"{'; '.join(changed) or 'no change'} ({base['seconds']:g} > {other['seconds']:g} s)"


def main() -> int:
    """Parse, make, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--make", type=Path, required=True, metavar="DIR", help="where recordings and results lie")
    parser.add_argument("--rules", nargs="+", required=True, metavar="NAME[=VALUE]", help="rules to vary")
    parser.add_argument("--cases", nargs="*", default=[], metavar="PATTERN", help="case names or patterns of them")
    parser.add_argument("--many", action="store_const", const="many", default="", help="cases of 6 to 20 effects")
    parser.add_argument("--limit", type=int, default=2, help="at most so many cases, spread evenly over the list")
    parser.add_argument("--dev", type=int, default=DEV, metavar="SEED", help="a seed of development")
    parser.add_argument("--results", type=Path, default=None, help="JSON lines")
    args = parser.parse_args()
    if args.dev == SCORED:
        parser.error(f"--dev {SCORED} is the seed that is scored")
    root, at = args.make / f"dev-{args.dev}", str(commit())
    results = args.results or root / "rules.jsonl"
    try:
        asked, chosen = trials(args.rules), choose(tuple(args.cases), args.dev, args.limit, args.many)
        make(root, chosen, say=lambda text: print(text, file=sys.stderr))
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    lines = results.read_text().splitlines(keepends=True) if results.exists() else []
    known = [json.loads(line) for line in lines if line.endswith("\n")]  # one cut short by a kill is run again
    results.parent.mkdir(parents=True, exist_ok=True)
    results.write_text("".join(line for line in lines if line.endswith("\n")))
    for case in chosen:
        base = None
        for values in asked:
            key = {"case": case.name, "seed": case.seed, "commit": at, "values": json.loads(json.dumps(values))}
            found = next((r for r in known if key.items() <= r.items() and not at.endswith("-dirty")), None)
            if found is None:
                found = key | run(root, case, values)
                with results.open("a") as file:
                    file.write(json.dumps(found) + "\n")
            base = base or found
            said = ", ".join(f"{name} = {value}" for name, value in values.items())
            what = f"{found['verdict']}, {found['names']}, {found['error']:g} x the floor, {found['seconds']:g} s"
            print(f"{case.name}  {said}: {difference(base, found)}" if said else f"{case.name}: {what}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
