"""Measure the error of the physics step: a scripted episode at each number of substeps, compared with the finest.

    python scripts/bench/contact_steps.py

Phases: a free move, a drop onto the block beside the hole, a press, a slide against the wall inside the hole. Columns:
tip path error in free motion (mm RMS), peak force of the impact (N), penetration under the press (mm), force at the
wall (N), CPU time.
"""

from __future__ import annotations

import time

import numpy as np

from vispeg.task.environments.simulation import TaskSimulation
from vispeg.task.peg.config import PegConfig
from vispeg.worlds.world import World

PHASES = {  # start of the tip relative to the mouth (m), actions (n, 3)
    "free": ((0.01, -0.01, 0.04), np.tile([0.6, 0.6, -0.2], (6, 1))),
    "press": ((0.02, 0.0, 0.01), np.tile([0.0, 0.0, -0.8], (8, 1))),
    "wall": ((0.0, 0.0, -0.012), np.tile([0.8, 0.0, 0.0], (8, 1))),
}


def play(config: PegConfig, phase: str) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Return tip path (k, 3) m, contact force of each control tick (N), height of the tip under the press, CPU s.

    The height is in m; the peg leans, so its middle stands above its edge.
    """
    start, actions = PHASES[phase]
    sim = TaskSimulation(World(), config, 1)
    sim.reset(np.arange(1), [0])
    place(sim, np.array(start))
    before, path = time.process_time(), []
    for action in actions:
        sim.step(action[None])
        path.append(sim.tip_in_goal()[0])
    depth = float(path[-1][2]) if phase == "press" else 0.0
    return np.array(path), np.concatenate(sim.tracks[0].forces), depth, time.process_time() - before


def place(sim: TaskSimulation, tip: np.ndarray) -> None:
    """Move the arm so that the peg's tip stands there in the hole's frame, at rest."""
    from vispeg.interface.observer import DOWN
    from vispeg.sim.reach import reach

    pos = (sim.nominal_goal + tip + [0, 0, sim.scene.tip])[None]
    q, _ = reach(sim.control.nominal, pos, DOWN[None], sim.home)
    sim.cell.begin(np.arange(1), [World()], q, sim.control.nominal.gravity(q).copy())
    sim.cell.read()
    sim.seen.goal[:] = pos
    sim.seen.see(q, np.zeros_like(q))


def main() -> None:
    """Print the table."""
    finest = None
    print("| substeps | step, ms | free path, mm | impact, N | tip under the press, mm | wall, N | CPU, s |")
    print("|---|---|---|---|---|---|---|")
    for n in (40, 20, 10, 5, 4, 3, 2, 1):
        config = PegConfig(substeps=n, clearance_mm=0.5, steps=1000, force_abort=1e9)
        free, press, wall = (play(config, phase) for phase in PHASES)
        finest = free[0] if finest is None else finest
        off = 1e3 * np.sqrt(np.mean(np.sum((free[0] - finest) ** 2, axis=1)))
        cost = free[3] + press[3] + wall[3]
        print(
            f"| {n} | {5 / n:.3g} | {off:.4f} | {press[1].max():.1f} | {1e3 * press[2]:.4f} | "
            f"{wall[1][-32:].mean():.2f} | {cost:.2f} |"
        )


if __name__ == "__main__":
    main()
