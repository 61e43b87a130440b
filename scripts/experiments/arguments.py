"""The command line that the experiments share."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from training import NEVER_EARLY, Budget

from vispeg.core.errors import UserError


def parser(about: str) -> argparse.ArgumentParser:
    """Return the parser of seeds, budget and folders; `about` is the script's docstring."""
    made = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3], help="training seeds, one after the other")
    made.add_argument("--steps", type=int, default=32_000, help="environment steps of every run")
    made.add_argument("--every", type=int, default=3_200, help="steps between a run's evaluations and checkpoints")
    made.add_argument(
        "--until", type=float, default=NEVER_EARLY, help="success in two evaluations in a row that ends a run; 2: never"
    )
    made.add_argument("--judged", type=int, default=50, help="episodes of a run's own evaluations")
    made.add_argument("--stack", type=int, default=2, help="observations and actions that a feed-forward actor sees")
    made.add_argument("--episodes", type=int, default=200, help="held-out episodes of every policy in every world")
    made.add_argument("--runs", type=Path, default=Path("runs/experiments"), help="folder of runs, kept for next time")
    made.add_argument("--out", type=Path, default=Path("docs/results"), help="folder of the results")
    return made


def budget(given: argparse.Namespace) -> Budget:
    """Return the budget on the command line."""
    return Budget(given.steps, given.every, given.judged, given.until)


def told(main: Callable[[], None]) -> None:
    """Run `main`; report a user's mistake in one line, with exit status 2."""
    try:
        main()
    except UserError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
