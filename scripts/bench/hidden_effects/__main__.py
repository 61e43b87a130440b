"""Hidden-effect benchmark: what does `vispeg diagnose` find in plants that hide something from it?

    python scripts/bench/hidden_effects --make DIR --only "coulomb_friction/joint4/*" --dev
    python scripts/bench/hidden_effects --make DIR --run --limit 20 --out report.md
    python scripts/bench/hidden_effects --make DIR --run --reference --baseline --out report.md
    python scripts/bench/hidden_effects --make DIR --many --run --limit 8
    python scripts/bench/hidden_effects --make DIR --many --reference
    python scripts/bench/hidden_effects --make DIR --soft --run --limit 8
    python scripts/bench/hidden_effects --make DIR --propose --limit 96 --dev 31001

Cases are deterministic by seed. `--dev` draws them with a seed that is not scored, `--dev 901` with
that: tune only on those.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
sys.path.insert(0, str(Path(__file__).resolve().parent))


def main() -> int:
    """Parse, make, run, report."""
    from cases import DEV, SCORED, choose
    from everywhere import ENGINES

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--make", type=Path, required=True, metavar="DIR", help="where recordings and results lie")
    parser.add_argument("--only", nargs="*", default=[], metavar="PATTERN", help="case names or patterns of them")
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--many", action="store_const", dest="group", const="many", default="", help="6 to 20 effects")
    group.add_argument("--soft", action="store_const", dest="group", const="soft", help="15 to 25, under soft gains")
    parser.add_argument("--limit", type=int, default=None, help="at most so many cases, spread evenly over the list")
    parser.add_argument("--dev", nargs="?", type=int, const=DEV, metavar="SEED", help="a seed of development")
    parser.add_argument("--list", action="store_true", help="print the chosen cases and stop")
    parser.add_argument("--run", action="store_true", help="diagnose the chosen cases and print the score")
    parser.add_argument("--propose", action="store_true", help="score what is proposed before any rollout, alone")
    parser.add_argument("--reference", action="store_true", help="fit the true effects, as an oracle")
    parser.add_argument("--baseline", action="store_true", help="with --reference: also fit a fixed parameter set")
    parser.add_argument("--workers", type=int, default=2, help="diagnoses at a time")
    parser.add_argument("--engine", choices=ENGINES, default="local", help="threads of this process, or a Ray cluster")
    parser.add_argument("--results", type=Path, default=None, help="JSON lines; those that are there are not run again")
    parser.add_argument("--out", type=Path, default=None, help="also write the score, as Markdown")
    args = parser.parse_args()
    from make import folders, make
    from proposed import run as propose
    from proposed import table
    from runner import refer, run
    from score import report

    from vispeg.core.errors import UserError

    if args.dev == SCORED:
        parser.error(f"--dev {SCORED} is the seed that is scored")
    seed = SCORED if args.dev is None else args.dev
    root = args.make / ("scored" if args.dev is None else f"dev-{seed}")
    try:
        if args.baseline and not (args.run and args.reference):
            raise UserError("--baseline goes with --run and --reference")
        if args.workers < 1:
            raise UserError("--workers must be at least 1", got=args.workers)
        chosen = choose(tuple(args.only), seed, args.limit, args.group)
        if args.list:
            print("\n".join(f"{c.name}  [{c.mode}]" for c in chosen))
            return 0
        make(root, chosen, say=lambda text: print(text, file=sys.stderr))
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    if args.propose:
        text = table(propose(root, chosen, args.results or root / "proposed.jsonl"))
        print(text)
    elif args.run:
        results = args.results or root / "results.jsonl"
        text = report(run(root, chosen, results, args.workers, args.reference, args.baseline, args.engine))
        print(text)
    elif args.reference:
        text = refer(root, chosen, args.results or root / "references.jsonl", args.workers, args.engine)
        print(text)
    else:
        for case in chosen:
            print(case.name, case.mode, folders(root, case)[0].parent)
        return 0
    if args.out is not None:
        part = args.out.with_name(args.out.name + ".part")
        part.write_text(text)
        part.replace(args.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
