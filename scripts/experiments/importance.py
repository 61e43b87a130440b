"""The order of importance of what training randomizes: one factor at a time left out, RGB and depth.

    python scripts/experiments/importance.py --seeds 1 2 3
    python scripts/experiments/importance.py --seeds 1 --steps 2500 --modalities depth --judged 20 --episodes 60

An article ranks what a policy that sees has to be trained with: textures, lights, camera, background, distractors,
noise (docs/sources.md). Here each policy imitates the same teacher in the world `S`, or in S with everything of one
factor at null; all have the same budget, and are judged on the same held-out episodes where looks were never trained on
(V), where the sensor is another one (N), and where the plant is another one as well (VNP). A factor matters by what the
policy that was trained without it loses there, paired over training seeds and episodes.

A command that was stopped goes on when given again: runs and episodes are kept, the table is written anew after every
run. What it costs: 42 runs by default, of 30 minutes (depth) and 45 (RGB) of one core with 20000 steps, 26 hours in
all; the second command is seven runs of about three minutes, and as long again for the episodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import arguments
import yaml
from evaluation import played
from results import write_result
from training import Variant, trained
from transfer_table import markdown, success_table

from vispeg.core.effect import effect
from vispeg.core.files import write_text_atomic
from vispeg.task.world_file import FORMAT, load_world
from vispeg.worlds.randomized import RandomizedWorld

BASE, TEACHER, ALL = "S", "state-3mm-randomized", "everything"
WORLDS = ("V", "N", "VNP")
STEPS = 20_000
LOOKS = {"depth": 1, "rgb": 3}  # of each state, as the shipped students of the same teacher saw them
FACTORS: dict[str, frozenset[str]] = {
    "textures": frozenset({"part_colour", "part_texture", "material_finish"}),
    "lights": frozenset(
        {"light_count", "light_position", "light_direction", "light_temperature", "light_intensity", "shadows"}
        | {"ambient_light"}
    ),
    "camera": frozenset({"camera_offset", "focal_error", "principal_point_error", "lens_distortion"}),
    "background": frozenset({"background", "sky"}),
    "distractors": frozenset({"distractors", "occlusion"}),
}
NOISE = "noise"  # what else a sensor does to colour and depth


def factor_of(name: str) -> str | None:
    """The factor that an effect belongs to; None for what no camera sees of itself: physics."""
    named = [factor for factor, names in FACTORS.items() if name in names]
    return named[0] if named else NOISE if effect(name).family == "camera" else None


def factors() -> tuple[str, ...]:
    """All of them, in the article's order."""
    return (*FACTORS, NOISE)


def world_without(factor: str, folder: Path) -> Path:
    """The file of S in which nothing of a factor is drawn, written into `folder`."""
    entries: dict[tuple[str, str], dict[str, Any]] = {}
    world = RandomizedWorld.of(load_world(BASE).world)
    for e in (*world.ranges, *world.base.effects):
        if factor_of(e.effect) == factor:
            absent = {k: p.null for k, p in effect(e.effect).params.items() if not p.shape}
            source = f"left out: {factor}"
            entries[e.effect, e.where] = {"effect": e.effect, "where": e.where, "params": absent, "source": source}
    about = f"S without its {factor}."
    text = {"format": FORMAT, "name": f"S-no-{factor}", "about": about, "base": BASE, "effects": [*entries.values()]}
    path = folder / f"S-no-{factor}.yaml"
    folder.mkdir(parents=True, exist_ok=True)
    write_text_atomic(path, yaml.safe_dump(text, sort_keys=False), overwrite=True)
    return path


def variants(modality: str, folder: Path) -> list[Variant]:
    """With everything, and without each factor."""
    worlds = {ALL: BASE} | {f"no {f}": str(world_without(f, folder).resolve()) for f in factors()}
    options = {"modality": modality, "teacher": TEACHER, "looks": LOOKS[modality]}
    return [
        Variant(f"{modality}, {name}".replace(", ", "-").replace(" ", "-"), w, **options) for name, w in worlds.items()
    ]


def lost(table: dict[str, Any], modality: str) -> list[dict[str, Any]]:
    """What each factor's absence costs in one world: paired differences to the policy with everything, worst first."""
    whole, out = f"{modality}-{ALL}", []
    for c in table["comparisons"]:
        if whole in (c["first"], c["second"]):
            sign = 1.0 if c["first"] == whole else -1.0
            other = c["second"] if sign > 0 else c["first"]
            if not other.startswith(f"{modality}-no-"):
                continue
            d = c["difference"]
            low, high = sorted((sign * d["low"], sign * d["high"]))
            factor = other.removeprefix(f"{modality}-no-")
            out.append({"factor": factor, "costs": sign * d["value"], "low": low, "high": high, "p": c["p"]})
    return sorted(out, key=lambda row: -row["costs"])


def order(tables: Sequence[dict[str, Any]], modalities: Sequence[str]) -> str:
    """Markdown: a row a factor, points of success that training without it costs, a column a modality and world."""
    heads = ["left out", *(f"{m}, {t['world']}" for m in modalities for t in tables)]
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    every = {(m, t["world"], row["factor"]): row for m in modalities for t in tables for row in lost(t, m)}
    for factor in factors():
        cells = []
        for key in ((m, t["world"], factor) for m in modalities for t in tables):
            row = every.get(key)
            said = (
                ""
                if row is None
                else f"{100 * row['costs']:+.0f} ({100 * row['low']:+.0f} to {100 * row['high']:+.0f})"
            )
            cells.append(said or "-")
        lines.append("| " + " | ".join([factor, *cells]) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Trains, judges, writes OUT/importance.json and OUT/importance.md."""
    parser = arguments.parser(__doc__ or "")
    parser.set_defaults(steps=STEPS)
    parser.add_argument("--modalities", nargs="+", choices=LOOKS, default=list(LOOKS), help="what policies see")
    given = parser.parse_args()
    budget = arguments.budget(given)
    ways = [v for m in given.modalities for v in variants(m, given.runs / "worlds")]
    finished: list[tuple[str, Path]] = []
    for seed in given.seeds:
        for variant in ways:
            finished.append((variant.name, trained(given.runs, variant, seed, budget)))
            episodes = played(finished, WORLDS, given.episodes, given.runs / "importance" / f"episodes-{given.steps}")
            tables = [success_table(episodes, load_world(world).name) for world in WORLDS]
            costs = {m: {t["world"]: lost(t, m) for t in tables} for m in given.modalities}
            values = {"experiment": "importance", "judged": tables, "costs": costs}
            write_result(given.out / "importance.json", values, budget, given.seeds, WORLDS)
            text = "\n".join([order(tables, given.modalities), *(f"## {t['world']}\n\n{markdown(t)}" for t in tables)])
            write_text_atomic(given.out / "importance.md", text, overwrite=True)


if __name__ == "__main__":
    arguments.told(main)
