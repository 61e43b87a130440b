"""Compare options of `vispeg train`: the reward, the stack, a teacher that knows the physics, a policy that turns.

    python scripts/experiments/training_options.py --seeds 1 2 3 --steps 32000
    python scripts/experiments/training_options.py --study stack --seeds 1 --steps 12800 --every 2560 --judged 25

All policies of a study have the same budget and are judged on the same held-out episodes; run by run, the checkpoint
counts that was best in the run's own evaluations. A run that two studies share is trained once. A command that was
stopped goes on when given again; results and pictures are made anew after every run.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import arguments
from curve_picture import draw
from curves import read_curve, together
from evaluation import played
from results import write_result
from training import Variant, trained
from transfer_table import markdown, success_table

from vispeg.core.files import write_text_atomic
from vispeg.task.world_file import load_world

TILTED = str(Path(__file__).with_name("tilted.yaml"))
TURNING = ("x", "y", "z", "rx", "ry")


@dataclass(frozen=True)
class Study:
    """Policies that are compared, and the worlds that they are judged in."""

    variants: dict[str, Variant]
    worlds: tuple[str, ...]


PLAIN = Variant("ff-randomized", "randomized")
STUDIES = {
    "teacher": Study(
        {
            "state": PLAIN,
            "state and ground truth": Variant("privileged-randomized", "randomized", modality="privileged"),
        },
        ("randomized",),
    ),
    "reward": Study(
        {
            "shaped": Variant("ff-nominal", "searching"),
            "paper": Variant("ff-nominal-paper", "searching", reward="paper"),
        },
        ("searching", "randomized"),
    ),
    "turn": Study(
        {
            "x y z": Variant("translating-tilted", TILTED),
            "x y z rx ry": Variant("turning-tilted", TILTED, dof=TURNING),
        },
        (TILTED, "searching"),
    ),
    "stack": Study(
        {
            f"n = {n}": PLAIN if n == PLAIN.stack else Variant(f"ff-randomized-{n}", "randomized", n)
            for n in (1, 2, 4, 8)
        },
        ("randomized", "searching"),
    ),
}


def main() -> None:
    """Train, judge; write OUT/training_STUDY.json and .md, and the pictures."""
    parser = arguments.parser(__doc__ or "")
    parser.add_argument("--study", nargs="+", choices=STUDIES, default=list(STUDIES), help="what is compared")
    parser.add_argument("--pictures", type=Path, default=Path("docs/img"), help="folder of the pictures")
    given = parser.parse_args()
    budget = arguments.budget(given)
    for name in given.study:
        study, finished = STUDIES[name], {}
        for seed in given.seeds:
            for words, variant in study.variants.items():
                folder = trained(given.runs, variant, seed, budget)
                finished.setdefault(words, []).append((seed, folder))
                policies = [(variant_of, f) for variant_of, runs in finished.items() for _, f in runs]
                place = given.runs / name / f"episodes-{given.steps}"
                episodes = played(policies, study.worlds, given.episodes, place)
                judged = [success_table(episodes, load_world(world).name) for world in study.worlds]
                variants = [described(w, study.variants[w], runs) for w, runs in finished.items()]
                values: dict[str, Any] = {"experiment": f"training_{name}", "variants": variants, "judged": judged}
                write_result(given.out / f"training_{name}.json", values, budget, given.seeds, study.worlds)
                text = "\n".join(f"{table['world']}\n\n{markdown(table)}" for table in judged)
                write_text_atomic(given.out / f"training_{name}.md", text, overwrite=True)
                draw(variants, given.pictures / f"training-{name}.png")


def described(words: str, variant: Variant, runs: list[tuple[int, Path]]) -> dict[str, Any]:
    """Return a variant with the curves of its runs, under the name that it has in the study."""
    curves = [read_curve(folder / "progress.csv") for _, folder in runs]
    each = [
        {"seed": seed, **{k: v.tolist() for k, v in asdict(curve).items()}}
        for (seed, _), curve in zip(runs, curves, strict=True)
    ]
    return {
        **asdict(variant),
        "world": load_world(variant.world).name,
        "name": words,
        "runs": each,
        "curve": together(curves),
    }


if __name__ == "__main__":
    arguments.told(main)
