"""Hidden-contact benchmark: what does `vispeg diagnose peg-cell` find in a plant whose contact hides something?

    python scripts/bench/hidden_contact --make DIR --cases "friction/*" "none/0*" --dev
    python scripts/bench/hidden_contact --make DIR --run --limit 16 --out report.md --json hidden_contact.json
    python scripts/bench/hidden_contact --make DIR --run --json docs/results/hidden_contact.json
    python scripts/bench/hidden_contact --make DIR --reference

The plant shares no code with the model and is not MuJoCo: analytic peg and hole, Hunt-Crossley contact, its own
integrator. Cases are deterministic by seed. `--dev` draws them with a seed that is not scored, `--dev 901` with that:
tune only on those.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "hidden_effects"))
sys.path.insert(0, str(Path(__file__).resolve().parent))


def main() -> int:
    """Parse, make, run, report."""
    from contact_cases import DEV, SCORED, choose
    from everywhere import ENGINES

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--make", type=Path, required=True, metavar="DIR", help="where recordings and results lie")
    parser.add_argument("--cases", nargs="*", default=[], metavar="PATTERN", help="case names or patterns of them")
    parser.add_argument("--limit", type=int, default=None, help="at most so many cases, spread evenly over the list")
    parser.add_argument("--dev", nargs="?", type=int, const=DEV, metavar="SEED", help="a seed of development")
    parser.add_argument("--list", action="store_true", help="print the chosen cases and stop")
    parser.add_argument("--run", action="store_true", help="diagnose the chosen cases and print the score")
    parser.add_argument("--reference", action="store_true", help="fit the true effects instead of searching for them")
    parser.add_argument("--engine", choices=ENGINES, default="local", help="this process, or a Ray cluster")
    parser.add_argument("--workers", type=int, default=1, help="diagnoses at a time, on a cluster")
    parser.add_argument("--results", type=Path, default=None, help="JSON lines; those that are there are not run again")
    parser.add_argument("--out", type=Path, default=None, help="also write the score, as Markdown")
    parser.add_argument("--json", type=Path, default=None, help="also write the records, as JSON")
    args = parser.parse_args()
    from contact_make import folders, make
    from contact_runner import diagnose, finished, reference, run
    from contact_score import references, report

    if args.dev == SCORED:
        parser.error(f"--dev {SCORED} is the seed that is scored")
    seed = SCORED if args.dev is None else args.dev
    root = args.make / ("scored" if args.dev is None else f"dev-{seed}")
    try:
        chosen = choose(tuple(args.cases), seed, args.limit)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    if args.run and args.reference:
        print("--run and --reference are two runs", file=sys.stderr)
        return 2
    if args.reference:
        chosen = [c for c in chosen if c.hidden]
    if args.list:
        print("\n".join(f"{c.name}  [{c.kind}]" for c in chosen))
        return 0
    results = args.results or root / ("references.jsonl" if args.reference else "results.jsonl")
    there = finished(results, seed) if args.run or args.reference else {}
    make(root, [c for c in chosen if c.name not in there], say=lambda text: print(text, file=sys.stderr, flush=True))
    if not (args.run or args.reference):
        for case in chosen:
            print(case.name, folders(root, case)["judge"].parent)
        return 0
    records = run(root, chosen, results, reference if args.reference else diagnose, args.workers, args.engine)
    text = references(records) if args.reference else report(records)
    print(text)
    for file, content in ((args.out, text), (args.json, json.dumps(records, indent=1) + "\n")):
        if file is not None:
            part = file.with_name(file.name + ".part")
            part.write_text(content)
            part.replace(file)
    return 0


if __name__ == "__main__":
    sys.exit(main())
