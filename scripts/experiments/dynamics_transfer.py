"""Dynamics transfer: policies of nominal, randomized, and identified + randomized physics in a plant they never saw.

    python scripts/experiments/dynamics_transfer.py --seeds 1 2 3

The plant hides several effects at once. It is recorded and diagnosed (`vispeg record`, `vispeg diagnose`), and what the
diagnosis writes becomes the third training world: fitted values as centres, their intervals as widths, and the ranges
of `randomized` for all the rest. Every policy has the same budget, and its best checkpoint in its own training world is
judged on the same held-out episodes there and in the plant. A command that was stopped goes on when given again; the
results are written anew after every training seed.
"""

from __future__ import annotations

import shutil

import arguments
from evaluation import played
from identification import identified_world, identify, told
from results import write_result
from training import Variant, run_folder, trained
from transfer_table import markdown, success_table

from vispeg.core.files import write_text_atomic
from vispeg.task.world_file import BUILT_IN, load_world

PLANT = BUILT_IN / "parts" / "plant.yaml"


def main() -> None:
    """Identifies, trains, judges; writes dynamics_transfer.json and .md, the identified model and the world of it."""
    given = arguments.parser(__doc__ or "").parse_args()
    work, budget = given.runs / "dynamics_transfer", arguments.budget(given)
    model = identify(PLANT, work / "identification")
    identified = identified_world(model, "randomized", work / "identified.yaml")
    given.out.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(model, given.out / "dynamics_model.yaml")
    shutil.copyfile(identified, given.out / "dynamics_identified.yaml")
    variants = [
        Variant("ff-nominal", "searching", given.stack),
        Variant("ff-randomized", "randomized", given.stack),
        Variant("ff-identified", str(identified), given.stack),
    ]
    worlds = [*(v.world for v in variants), str(PLANT)]
    for done, seed in enumerate(given.seeds, 1):
        for variant in variants:
            trained(given.runs, variant, seed, budget)
        seeds = given.seeds[:done]
        episodes = []
        for variant in variants:
            policies = [(variant.name, run_folder(given.runs, variant, s)) for s in seeds]
            home = [variant.world, str(PLANT)]
            episodes += played(policies, home, given.episodes, work / f"episodes-{given.steps}")
        plant = success_table(episodes, load_world(PLANT).name)
        own = [success_table(episodes, load_world(v.world).name) for v in variants]
        values = {"experiment": "dynamics_transfer", "diagnosis": told(model), "plant": plant, "own_world": own}
        write_result(given.out / "dynamics_transfer.json", values, budget, seeds, worlds, [model])
        write_text_atomic(given.out / "dynamics_transfer.md", text(plant, own), overwrite=True)


def text(plant: dict, own: list[dict]) -> str:
    """The tables as Markdown."""
    parts = ["In the plant:", markdown(plant), "Each in the world that it was trained in:"]
    rows = [markdown(table).splitlines() for table in own]
    parts.append("\n".join([*rows[0][:2], *(lines[2] for lines in rows)]) + "\n")
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


if __name__ == "__main__":
    arguments.told(main)
