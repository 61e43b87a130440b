"""Dynamics transfer: five ways to train, judged in plants they never saw, paired over plants, seeds and episodes.

    python scripts/experiments/dynamics_transfer.py --seeds 1 2 3
    python scripts/experiments/dynamics_transfer.py --plants 10 --steps 51200 --every 2560 --until .95 --ranges gated

naive: nominal physics. randomized: physics drawn in every episode. identified: nominal physics and what a diagnosis of
the plant named. identified+randomized: `randomized`, in which what was named takes the place of the ranges: fitted
values as centres, their intervals as widths. from-randomized: half of the steps as `randomized`, the other half in the
world of identified+randomized. Every plant hides several effects at once (`plants.py`); it is recorded
and diagnosed (`vispeg record`, `vispeg diagnose`). Every policy has the same budget, and its best checkpoint in its own
training world is judged on the same held-out episodes in the plant. A world with what was identified is harder to
learn from the first step on. With `--ranges schedule` all draws open from nominal over the first half of the steps,
with `gated` to a half and then whole, each as soon as half of an evaluation's episodes succeed; for all ways alike.

A command that was stopped goes on when given again: recordings, diagnosis, runs and episodes are kept, and the results
are written anew after every plant and training seed. naive and randomized are trained once for all plants.

What it costs: 7 to 13 processor seconds a thousand steps, so 3 to 6 minutes a run of 25600. N plants and K seeds are
2 K (N + 1) runs and N diagnoses of 2 to 5 minutes: the second command is 66 runs, 3 to 6 hours of one core, and an
hour more for diagnoses and episodes; `--ways` leaves some out. Two processes share it with `--first` and an own
`--out`, once the runs of naive and randomized, which all plants use, are there.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import arguments
from evaluation import played
from identification import identified_world, identify, told
from over_plants import compared
from over_plants import markdown as over
from plants import hidden_plant
from results import write_result
from training import Budget, Variant, run_folder, trained
from transfer_table import markdown, success_table

from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.task.world_file import load_world

NAIVE, RANDOMIZED, IDENTIFIED, BOTH = "naive", "randomized", "identified", "identified+randomized"
FROM = "from-randomized"
WAYS = (NAIVE, RANDOMIZED, IDENTIFIED, BOTH, FROM)
BASES = {NAIVE: "searching", RANDOMIZED: "randomized"}


def ways(model: Path, work: Path, number: int, stack: int, ranges: str) -> dict[str, Variant]:
    """Return the run of each way for a plant; where nothing was named, the identified ones are those without."""
    found = {way: Variant(f"ff-{way}-{ranges}", world, stack, ranges=ranges) for way, world in BASES.items()}
    for way, base in ((IDENTIFIED, NAIVE), (BOTH, RANDOMIZED)):
        try:
            world = identified_world(model, BASES[base], work / f"{BASES[base]}-identified-{number}.yaml")
        except UserError as error:
            print(f"plant {number}: {error}", file=sys.stderr)
            found[way] = found[base]
            continue
        found[way] = Variant(f"ff-{BASES[base]}-identified-{number}-{ranges}", str(world), stack, ranges=ranges)
    half = replace(found[RANDOMIZED], name=f"{found[RANDOMIZED].name}-half")
    found[FROM] = replace(found[BOTH], name=f"{found[BOTH].name}-from", begun=half)
    return found


def main() -> None:
    """Identify, train, judge; write dynamics_transfer.json and .md after every plant and seed."""
    parser = arguments.parser(__doc__ or "")
    parser.add_argument("--plants", type=int, default=1, help="hidden plants to draw, the bundled one first")
    parser.add_argument("--first", type=int, default=0, help="plants to leave out at the start, to share the work out")
    parser.add_argument(
        "--ranges", default="full", choices=["full", "schedule", "adaptive", "gated"], help="how they open"
    )
    parser.add_argument("--ways", nargs="+", default=[*WAYS], choices=WAYS, help="of training")
    given = parser.parse_args()
    if given.first >= given.plants:
        raise UserError("no plant is left", key="--first", expected=f"less than {given.plants}", got=given.first)
    work, budget = given.runs / "dynamics_transfer", arguments.budget(given)
    given.out.mkdir(parents=True, exist_ok=True)
    tables: dict[int, dict[str, Any]] = {}
    about: dict[str, Any] = {}
    for number in range(given.first, given.plants):
        plant = hidden_plant(number, work)
        model = identify(plant, work / f"identification-{number}")
        spent(f"plant {number}: identified")
        variants = {w: v for w, v in ways(model, work, number, given.stack, given.ranges).items() if w in given.ways}
        about[load_world(plant).name] = told(model)
        for done, seed in enumerate(given.seeds, 1):
            for variant in variants.values():
                trained(given.runs, variant, seed, budget)
            spent(f"plant {number}, seed {seed}: trained")
            seeds = given.seeds[:done]
            who = [(way, run_folder(given.runs, v, s)) for way, v in variants.items() for s in seeds]
            episodes = played(
                who, [str(plant)], given.episodes, work / f"episodes-{number}-{given.ranges}-{given.steps}"
            )
            tables[number] = success_table(episodes, load_world(plant).name)
            spent(f"plant {number}, seed {seed}: judged")
            write(given.out, tables, about, budget, given.seeds)


def write(out: Path, tables: Mapping[int, Any], about: Mapping[str, Any], budget: Budget, seeds: list[int]) -> None:
    """Write the results so far."""
    done = list(tables.values())
    there = {row["policy"] for row in done[0]["rows"]}
    pairs = [compared(done, second, first) for first, second in combinations([w for w in WAYS if w in there], 2)]
    values = {"experiment": "dynamics_transfer", "diagnoses": about, "plants": done, "comparisons": pairs}
    write_result(out / "dynamics_transfer.json", values, budget, seeds, BASES.values())
    parts = [f"### {table['world']}\n\n{markdown(table)}" for table in done]
    text = "\n".join([*parts, *(["### Over plants\n"] if pairs else []), *(over(pair) for pair in pairs)])
    write_text_atomic(out / "dynamics_transfer.md", text, overwrite=True)


def spent(what: str) -> None:
    """Print on standard error what this call has cost so far, with its children."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    seconds = sum(u.ru_utime + u.ru_stime for u in used)
    print(f"{seconds:8.0f} processor s  {what}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    arguments.told(main)
