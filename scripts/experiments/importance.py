"""The order of importance of what training randomizes: one factor at a time left out, RGB and depth.

    python scripts/experiments/importance.py --steps 20000 --states 8000 --updates 6000 --episodes 60
    python scripts/experiments/importance.py --worlds VNP

An article ranks what a policy that sees has to be trained with: textures, lights, camera, background, distractors,
noise (docs/sources.md). Here all policies begin as one student of a modality, who imitates a teacher in the world S
with every factor at null. Each then learns in S, in S with one factor at null or with all of them, from the same states
and labels with the same draws of batches: a seed's states are simulated once and photographed by the cameras of all of
these worlds, in colour and depth at once. So two policies of a seed differ in one factor of their pictures alone.

All are judged on the same held-out episodes where looks were never trained on (V), where the sensor is another one (N),
or where the plant is another one as well (VNP); and by how far from the truth they believe the goal to be, in pictures
of the same states of these worlds. A factor matters by what the policy without it loses.

A command that was stopped goes on when given again: runs, states and episodes are kept, and the tables are written anew
after every policy; what is not trained yet is a dash in them, and `importance.json` lists it under `missing`. The
second command takes about an hour and a half of one core: 48 policies.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import arguments
import numpy as np
import yaml
from evaluation import played
from importance_tables import ALL, NOTHING, farther, lost, millimetres, not_trained, order, points
from results import write_result
from same_states import MODE, pictured
from training import Budget, Variant, trained
from transfer_table import markdown, success_table

from vispeg.core.effect import effect
from vispeg.core.files import write_text_atomic
from vispeg.core.seeds import stream
from vispeg.formats.json_data import read_json
from vispeg.task.world_file import FORMAT, load_world
from vispeg.worlds.randomized import RandomizedWorld

BASE, TEACHER = "S", "state-3mm-randomized"
WORLDS = ("V", "N", "VNP")
MODALITIES = ("depth", "rgb")
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
ROWS, START_SEED, JUDGED_SEED = 16, 1, 2**31 + 1


def factor_of(name: str) -> str | None:
    """Return the factor that an effect belongs to; None for effects on physics, which no camera sees."""
    named = [factor for factor, names in FACTORS.items() if name in names]
    return named[0] if named else NOISE if effect(name).family == "camera" else None


def factors() -> tuple[str, ...]:
    """Return all factors, in the article's order."""
    return (*FACTORS, NOISE)


def world_without(left_out: tuple[str, ...], folder: Path, name: str) -> str:
    """Return the file of S in which nothing of these factors is drawn, written into `folder`."""
    entries: dict[tuple[str, str], dict[str, Any]] = {}
    world = RandomizedWorld.of(load_world(BASE).world)
    for e in (*world.ranges, *world.base.effects):
        if factor_of(e.effect) in left_out:
            absent = {k: p.null for k, p in effect(e.effect).params.items() if not p.shape}
            source = f"left out: {factor_of(e.effect)}"
            entries[e.effect, e.where] = {"effect": e.effect, "where": e.where, "params": absent, "source": source}
    about = f"S without its {', '.join(left_out)}."
    text = {"format": FORMAT, "name": f"S-{name}", "about": about, "base": BASE, "effects": [*entries.values()]}
    path = folder / f"S-{name}.yaml"
    folder.mkdir(parents=True, exist_ok=True)
    write_text_atomic(path, yaml.safe_dump(text, sort_keys=False), overwrite=True)
    return str(path.resolve())


def worlds(folder: Path) -> dict[str, str]:
    """Return the worlds that policies learn in: S, S without each factor, S without any of them."""
    alone = {f"no-{f}": world_without((f,), folder, f"no-{f}") for f in factors()}
    return {ALL: BASE} | alone | {NOTHING: world_without(factors(), folder, NOTHING)}


def start(runs: Path, modality: str, world: str, budget: Budget) -> Path:
    """Return the folder of the student of a modality that all begin as, trained if it is not there yet."""
    variant = Variant(f"{modality}-start", world, modality=modality, teacher=TEACHER)
    return trained(runs, variant, START_SEED, budget) / "checkpoints" / "best"


def states(folder: Path, seen_in: Mapping[str, str], seed: int, steps: int) -> dict[str, Any]:
    """Return the `pictured` states of these worlds, from `folder` where they are there."""
    from vispeg.learn.experience.replay import Replay
    from vispeg.learn.methods.rounds import keep_ring, kept_ring
    from vispeg.task.environments.vector import TaskVec

    if not all((folder / name).is_dir() for name in seen_in):
        for name, ring in pictured(seen_in, TEACHER, seed, ROWS, max(1, steps // ROWS)).items():
            keep_ring(ring, folder / name)
    env = TaskVec(1, BASE, MODE, privileged=True)
    like = Replay(2, env.single_observation_space, env.single_action_space)
    env.close()
    return {name: kept_ring(folder / name, like) for name in seen_in}


def learned(out: Path, begin: Path, world: str, ring: Any, seed: int, updates: int) -> Path:
    """Train the student `begin` by `updates` of imitation in a world's pictures; return `out`.

    The policy is in OUT/checkpoints/best; one that is there is not learned again.
    """
    import torch

    from vispeg.learn.methods.clone import CloneSettings, clone
    from vispeg.learn.policy import load, save

    folder = out / "checkpoints" / "best"
    if not (folder / "policy.json").is_file():
        torch.set_num_threads(1)
        torch.manual_seed(seed)
        policy, file = load(begin), load_world(world)
        actor = policy.actor.requires_grad_(True)
        clone(actor, [(ring, 1.0)], updates, CloneSettings(lr=1e-3, batch=64), stream(seed, "importance"))
        made = {"world": file.name, "world_hash": file.hash, "seed": seed, "updates": updates, "parent": str(begin)}
        save(folder, actor, policy.modality, {**policy.meta, **made})
    return out


def believed(folder: Path, ring: Any) -> list[float]:
    """Return the mean lateral error in mm of a policy's believed goal, by row of pictured states."""
    from vispeg.interface.terms import PRIVILEGED
    from vispeg.learn.layout import ESTIMATE, OFFSET_M
    from vispeg.learn.policy import load
    from vispeg.render.image_kinds import kind_of

    policy, sums = load(folder), np.zeros((2, ring.n_envs))
    keys = policy.actor.layout.keys
    for at in np.flatnonzero(ring.starts.any(axis=1)):
        stored = {key: ring.obs[key][at] for key in keys}
        obs = {key: v if (kind := kind_of(key)) is None else kind.unpack(v) for key, v in stored.items()}
        policy.reset(ring.n_envs)
        policy.act(obs)
        truth = OFFSET_M * ring.obs[PRIVILEGED][at][:, ESTIMATE]
        there = ring.starts[at]
        sums[:, there] += [1e3 * np.linalg.norm((policy.estimate - truth)[there, :2], axis=1), np.ones(there.sum())]
    return (sums[0] / sums[1]).tolist()


def policies(given: Any, budget: Budget, places: Mapping[str, str]) -> Iterator[tuple[str, Path]]:
    """Yield name and run folder of every policy, each as soon as it is trained."""
    begin = {m: start(given.runs, m, places[NOTHING], budget) for m in given.modalities}
    for seed in given.seeds:
        folder = given.runs / "states" / f"seed-{seed}-{given.states}"
        runs = {(m, w): given.runs / f"{m}-{w}-{given.updates}_s{seed}" for m in given.modalities for w in places}
        todo = [run for run in runs.values() if not (run / "checkpoints" / "best" / "policy.json").is_file()]
        rings = states(folder, places, seed, given.states) if todo else {}
        for (m, world), run in runs.items():
            yield f"{m}-{world}", learned(run, begin[m], places[world], rings.get(world), seed, given.updates)
        shutil.rmtree(folder, ignore_errors=True)  # some hundred megabytes


def belief(given: Any, run: Path, judged: Mapping[str, Any]) -> dict[str, list[float]]:
    """Return `believed` of a run's policy by judged world; kept in a file."""
    path = given.runs / "believed" / f"{run.name}-{given.updates}.json"
    if not path.is_file():
        values = {w: believed(run / "checkpoints" / "best", ring) for w, ring in judged.items()}
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text_atomic(path, json.dumps(values) + "\n", overwrite=True)
    return read_json(path)


def main() -> None:
    """Train, judge, write OUT/importance.json and OUT/importance.md."""
    parser = arguments.parser(__doc__ or "")
    parser.set_defaults(steps=3_000, every=600, judged=10, episodes=16, runs=Path("runs/importance"))
    parser.add_argument("--modalities", nargs="+", choices=MODALITIES, default=list(MODALITIES), help="what is seen")
    parser.add_argument(
        "--worlds", nargs="+", choices=WORLDS, default=list(WORLDS), help="in which episodes are played"
    )
    parser.add_argument("--states", type=int, default=1_200, help="states that the policies of a seed learn from")
    parser.add_argument("--updates", type=int, default=800, help="gradient steps of a policy after the common start")
    given = parser.parse_args()
    budget, places = arguments.budget(given), worlds(given.runs / "worlds")
    judged = {w: states(given.runs / "states" / f"judged-{w}", {w: w}, JUDGED_SEED, 24 * ROWS)[w] for w in WORLDS}
    finished: list[tuple[str, Path]] = []
    errors: dict[str, dict[str, list[list[float]]]] = {w: {} for w in WORLDS}  # world -> policy -> a list a seed
    for name, run in policies(given, budget, places):
        finished.append((name, run))
        for world, values in belief(given, run, judged).items():
            errors[world].setdefault(name, []).append(values)
        out = given.runs / f"episodes-{given.steps}-{given.states}-{given.updates}"
        episodes = played(finished, given.worlds, given.episodes, out)
        written(given, budget, episodes, errors, [run.name for _, run in finished])


def written(given: Any, budget: Budget, episodes: Any, errors: Mapping[str, Any], done: list[str]) -> None:
    """Write both files, from what is done."""
    tables = [success_table(episodes, load_world(world).name) for world in given.worlds]
    rows = (*factors(), "all of them")
    costs = {f"{m}, {t['world']}": lost(t, m) for m in given.modalities for t in tables}
    off = {w: {name: np.array(values) for name, values in by.items()} for w, by in errors.items()}
    misses = {f"{m}, {w}": farther(off[w], m) for m in given.modalities for w in WORLDS}
    left = (ALL, *(f"no-{f}" for f in factors()), NOTHING)
    names = [f"{m}-{w}" for m in given.modalities for w in left]
    missing = {s: [name for name in names if f"{name}-{given.updates}_s{s}" not in done] for s in given.seeds}
    spent = {"states": given.states, "updates": given.updates, "episodes": given.episodes}
    values = {"experiment": "importance", **spent, "missing": missing, "judged": tables, "costs": costs}
    mean = {w: {name: float(y.mean()) for name, y in by.items()} for w, by in off.items()}
    values |= {"believed_mm": mean, "misses_mm": misses}
    write_result(given.out / "importance.json", values, budget, given.seeds, WORLDS)
    parts = [
        "## Points of success lost\n\n" + order(costs, rows, points),
        "## Millimetres farther off the goal is believed to be\n\n" + order(misses, rows, millimetres),
        not_trained(missing, len(names)),
        *(f"## {t['world']}\n\n{markdown(t)}" for t in tables),
    ]
    write_text_atomic(given.out / "importance.md", "\n".join(parts), overwrite=True)


if __name__ == "__main__":
    arguments.told(main)
