"""An insertion policy in the hidden plant, in the nominal model and in the corrected one: peak force and duration.

    python scripts/bench/hidden_contact/contact_transfer.py friction/large rocking/large --episodes 12
    python scripts/bench/hidden_contact/contact_transfer.py friction/large --model DIR/diagnosis/KEY/model.yaml

Episodes are paired: the same scripted policy begins at the same places and is told a wrong place of the hole, so that
it lands on the top and searches. Without --model the corrected model has the true effects, as an oracle; with it those
that a diagnosis found. Figures are means of |model - plant| over the episodes; a peak is that of the contact force
averaged over 20 ms, as a wrist's sensor filters it: laws of contact differ in how sharp a blow is.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "hidden_effects"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import numpy as np
from contact_cases import SCORED, Case, choose
from contact_plant import COARSE, DOWN, FINE, MOUTH, RATE, TIP, Plant, Truth, held

from vispeg.core.effect import EffectInstance
from vispeg.task.environments.simulation import TaskSimulation
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.expert import Expert
from vispeg.task.peg.terms import TERMS
from vispeg.task.terms import Observation
from vispeg.worlds.model_file import load_model
from vispeg.worlds.world import World

SMOOTH = 0.02  # s
MISTAKE = (1.8e-3, -1.2e-3, 0.0)  # m: where the policy believes the hole to be, less where it is


@dataclass(frozen=True)
class Played:
    """Episodes: where the flange began (n, 3) m, peak contact force (n,) N, duration (n,) s, success (n,)."""

    start: np.ndarray
    peak: np.ndarray
    seconds: np.ndarray
    success: np.ndarray


def in_model(effects: tuple[EffectInstance, ...], config: PegConfig, episodes: int) -> Played:
    """Play the scripted policy in the project's cell with these effects."""
    told = EffectInstance.of("goal_imprecision", "hole", **dict(zip("xyz", MISTAKE, strict=True)))
    sim = TaskSimulation(World(effects=(*effects, told)), config, episodes)
    sim.reset(np.arange(episodes), list(range(episodes)))
    start, expert = sim.seen.goal.copy(), Expert(config, episodes)
    expert.reset(np.arange(episodes))
    records: list = [None] * episodes
    while any(r is None for r in records):
        ended = sim.step(expert.act(sim.observation()))[3]
        records = [old or new for old, new in zip(records, ended, strict=True)]
    peak = np.array([peak_of(np.array(r["force_profile"]), config.control_period) for r in records])
    return Played(start, peak, *(np.array([r[key] for r in records]) for key in ("time", "success")))


def peak_of(force: np.ndarray, period: float) -> float:
    """Return the greatest mean over SMOOTH s of a force (t,) N sampled every `period` s."""
    count = max(1, round(SMOOTH / period))
    return float(np.convolve(force, np.full(count, 1 / count), "valid").max(initial=0.0))


def in_plant(truth: Truth, config: PegConfig, start: np.ndarray) -> Played:
    """Play the same policy in the hidden plant, from the same flange positions (n, 3) m."""
    n = len(start)
    plant = Plant([truth] * n, start, np.tile(DOWN, (n, 1, 1)), np.full(n, config.force_limit))
    expert, layout = Expert(config, n), Observation(TERMS, config)
    expert.reset(np.arange(n))
    weight = np.array([0, 0, -9.81 * held(Truth())[0]])
    peak, forces = np.zeros(n), []
    seconds, success = np.full(n, config.steps * config.policy_period), np.zeros(n, bool)
    alive, felt = np.ones(n, bool), np.zeros((n, 3))
    rot = np.tile(DOWN, (n, 1, 1))
    for step in range(config.steps):
        seen = np.zeros((n, layout.policy_size))
        for name, value in (("tip", plant.pos - [0, 0, TIP] - MOUTH - truth.offset - MISTAKE), ("force", felt)):
            seen[:, layout[name]] = value / layout.term(name).scale
        goal = plant.pos + config.offset * expert.act({"policy": seen})[:, :3]
        for _ in range(round(config.policy_period * RATE)):
            plant.control(goal, rot)
            h = FINE if plant.near() else COARSE
            total = np.zeros((n, 3))
            for _ in range(round(1 / RATE / h)):
                plant.step(h)
                total += plant.load[:, :3] * h * RATE
            felt = -(plant.rot @ total[:, :, None])[:, :, 0] - weight
            forces.append(np.where(alive, np.linalg.norm(plant.force, axis=1), 0.0))
            peak = np.maximum(peak, forces[-1])
        inside = (plant.tip[:, 2] < -config.success_depth * config.depth) & alive
        over = alive & (inside | (peak > config.force_abort))
        seconds[over], success[inside] = (step + 1) * config.policy_period, True
        alive &= ~over
        if not alive.any():
            break
    smooth = np.array([peak_of(row, 1 / RATE) for row in np.array(forces).T])
    return Played(start, smooth, seconds, success & (peak <= config.force_abort))


def compare(case: Case, effects: tuple[EffectInstance, ...], episodes: int) -> dict:
    """Return the errors of the nominal and of the corrected model against the plant in one case."""
    config = PegConfig()
    models = {"nominal": in_model((), config, episodes), "corrected": in_model(effects, config, episodes)}
    plant = in_plant(case.truth, config, models["nominal"].start)
    out: dict = {
        "case": case.name,
        "episodes": episodes,
        "plant_peak_n": float(plant.peak.mean()),
        "plant_seconds": float(plant.seconds.mean()),
        "plant_success": float(plant.success.mean()),
    }
    for name, played in models.items():
        out[name] = {
            "peak_n": float(np.abs(played.peak - plant.peak).mean()),
            "seconds": float(np.abs(played.seconds - plant.seconds).mean()),
            "success": float(played.success.mean()),
        }
    return out


def main() -> int:
    """Play and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="+", help="case names or patterns")
    parser.add_argument("--episodes", type=int, default=12)
    parser.add_argument("--model", type=Path, default=None, help="model.yaml of a diagnosis of the one case")
    parser.add_argument("--json", type=Path, default=None, help="also write the figures")
    args = parser.parse_args()
    rows = []
    print("| case | error of peak force, nominal → corrected | of duration | success: plant, nominal, corrected |")
    print("|---|---|---|---|")
    for case in choose(tuple(args.cases), SCORED, None):
        true = tuple(EffectInstance.of(h["effect"], h["where"], **h["params"]) for h in case.hidden)
        r = compare(case, true if args.model is None else load_model(args.model).effects, args.episodes)
        rows.append(r)
        a, b = r["nominal"], r["corrected"]
        success = ", ".join(f"{100 * v:.0f} %" for v in (r["plant_success"], a["success"], b["success"]))
        print(
            f"| {case.name} | {a['peak_n']:.1f} → {b['peak_n']:.1f} N of {r['plant_peak_n']:.1f} | "
            f"{a['seconds']:.2f} → {b['seconds']:.2f} s of {r['plant_seconds']:.1f} | {success} |",
            flush=True,
        )
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
