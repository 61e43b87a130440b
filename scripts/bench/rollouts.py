"""Closed-loop rollouts against raw `mujoco.batch` physics at the same step sizes, in one run.

    python scripts/bench/rollouts.py [--rows 64] [--seconds 5] [--rounds 3]

The raw side steps the same model, rows, friction and steps with held controls; the closed loop adds the 500 Hz position
controller with nominal gravity, exact and along the measured motion as a diagnosis uses it. Processor seconds of one
thread, the least of some rounds that take turns, so that a busy machine spoils them little.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from mujoco import batch as mjb

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.identify.excitation import motion
from vispeg.identify.record import centre_of, controller
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.sim.plant import STIFF_FRICTION
from vispeg.sim.quiet import quiet
from vispeg.sim.rollout import simulate
from vispeg.sim.segments.segment import Segment
from vispeg.worlds.world import World


def raw(model, rows: int, ticks: int, substeps: int, friction: np.ndarray | None) -> float:
    """Return the seconds that `mujoco.batch` takes for the same steps, with `friction` (rows,) N m in joint 4."""
    batch = mjb.Batch(model, rows, nthread=1)
    h = 0.002 / substeps
    batch.expand("opt.timestep")[:] = h
    if friction is not None:
        batch.expand("dof_frictionloss")[:, 3] = friction
        batch.expand("dof_solref")[:], batch.expand("dof_solimp")[:] = (2 * h, 1.0), STIFF_FRICTION
    begin = time.process_time()
    with quiet():  # as rollouts do: without MuJoCo's profiler
        for _ in range(ticks):
            batch.step(nstep=substeps)
    return time.process_time() - begin


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    robot = load("iiwa14")
    control = controller(robot, "position", 500.0, centre_of(robot))
    m = motion("fourier", robot, 500.0, args.seconds, stream(0, "bench"))
    command = {"q_cmd": m.q_cmd, "dq_cmd": m.dq_cmd}
    segment = Segment(control, 0.002, command, m.q_cmd, m.dq_cmd, m.q_cmd, m.time, np.arange(len(m.time)))
    nominal = [World()] * args.rows
    level = 0.01 * np.arange(1, args.rows + 1)
    friction = [World().add(EffectInstance.of("coulomb_friction", "joint4", torque=float(x))) for x in level]
    print("| rollout: raw s, closed loop s, ratio | 2 ms | 1 ms | 0.5 ms |\n|---|---|---|---|")
    for name, worlds, along, dry in (
        ("exact gravity", nominal, False, None),
        ("gravity along the motion", nominal, True, None),
        ("the same with dry friction", friction, True, level),
    ):
        cells = []
        for substeps in (1, 2, 4):
            base, spent = np.inf, np.inf
            for _ in range(args.rounds):
                base = min(base, raw(compiled(robot), args.rows, segment.ticks, substeps, dry))
                begin = time.process_time()
                simulate(robot, worlds, [segment], h_max=0.002 / substeps, along=along)
                spent = min(spent, time.process_time() - begin)
            cells.append(f"{base:.2f}, {spent:.2f}, {base / spent:.2f}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
