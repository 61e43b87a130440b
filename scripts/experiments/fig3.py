"""Learning curves: feed-forward actors with stacked observations, and recurrent ones, with and without randomization.

    python scripts/experiments/fig3.py --seeds 1 2 3

The comparison of Fig. 3 in Kaspar and Bock, "Reinforcement Learning with Cartesian Commands and Sim to Real Transfer
for Peg in Hole Tasks", on this project's task: success and return against environment steps. Every run has the same
budget; every run's best checkpoint by its own evaluations is judged on the same held-out episodes in the world without
randomization and the one with it, whichever it was trained in. A command that was stopped goes on when given again;
results and picture are made anew after every run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import arguments
from curve_picture import draw
from curves import read_curve, together
from evaluation import played
from results import write_result
from training import Variant, trained
from transfer_table import success_table

from vispeg.task.peg.rewards import REWARDS
from vispeg.task.world_file import load_world

WORLDS = ("searching", "randomized")
LSTM = 128  # width
LEARNED = 0.8  # success rate; the step at which an evaluation first reaches it is reported


def main() -> None:
    """Train, judge, write OUT/fig3.json and draw the picture."""
    parser = arguments.parser(__doc__ or "")
    parser.add_argument("--picture", type=Path, default=Path("docs/img/fig3.png"), help="the picture")
    parser.add_argument(
        "--reward", choices=REWARDS.named, default="shaped", help="the task's; `paper` is that of the figure"
    )
    parser.add_argument("--lstm", type=int, default=LSTM, help="width of the LSTM")
    given = parser.parse_args()
    budget = arguments.budget(given)
    memories = {"ff": {"stack": given.stack}, "lstm": {"recurrent": given.lstm}}
    variants = [
        Variant(f"{memory}-{name}", world, reward=given.reward, **own)
        for memory, own in memories.items()
        for name, world in (("nominal", "searching"), ("randomized", "randomized"))
    ]
    finished: dict[str, list[tuple[int, Path]]] = {}
    for seed in given.seeds:
        for variant in variants:
            folder = trained(given.runs, variant, seed, budget)
            finished.setdefault(variant.name, []).append((seed, folder))
            policies = [(name, f) for name, runs in finished.items() for _, f in runs]
            episodes = played(policies, WORLDS, given.episodes, given.runs / "fig3" / f"episodes-{given.steps}")
            values = {
                "experiment": "fig3",
                "variants": [described(v, finished[v.name]) for v in variants if v.name in finished],
                "judged": [success_table(episodes, load_world(world).name) for world in WORLDS],
            }
            write_result(given.out / "fig3.json", values, budget, given.seeds, WORLDS)
            draw(values["variants"], given.picture)


def described(variant: Variant, runs: Sequence[tuple[int, Path]]) -> dict[str, Any]:
    """Return a variant's runs and the curve of all seeds."""
    curves = [read_curve(folder / "progress.csv") for _, folder in runs]
    each = [
        {
            "seed": seed,
            "steps": curve.steps.tolist(),
            "seconds": curve.seconds.tolist(),
            "success": curve.success.tolist(),
            "return": curve.returns.tolist(),
            "peak_force": curve.peak_force.tolist(),
            f"steps_to_{100 * LEARNED:.0f}": curve.reaches(LEARNED),
        }
        for (seed, _), curve in zip(runs, curves, strict=True)
    ]
    return {**asdict(variant), "runs": each, "curve": together(curves)}


if __name__ == "__main__":
    arguments.told(main)
