"""Closed-loop rollouts against raw `mujoco.batch` physics at the same step sizes, in one run.

    python scripts/bench/rollouts.py [--rows 64] [--seconds 5] [--threads 2]

The raw side steps the same model, rows and steps with held controls; the closed loop adds the 500 Hz position
controller with nominal gravity, exact and along the measured motion as a diagnosis uses it.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from mujoco import batch as mjb

from vispeg.core.effect import Placed
from vispeg.core.seeds import stream
from vispeg.core.world import World
from vispeg.identify.excitation import motion
from vispeg.identify.record import centre_of, controller
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.sim.rollout import simulate
from vispeg.sim.segment import Segment


def raw(model, rows: int, ticks: int, substeps: int, threads: int) -> float:
    """Seconds that `mujoco.batch` alone takes for the same steps."""
    batch = mjb.Batch(model, rows, nthread=threads)
    batch.expand("opt.timestep")[:] = 0.002 / substeps
    begin = time.perf_counter()
    for _ in range(ticks):
        batch.step(nstep=substeps)
    return time.perf_counter() - begin


def main() -> None:
    """Prints a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    robot = load("iiwa14")
    control = controller(robot, "position", 500.0, centre_of(robot))
    m = motion("fourier", robot, 500.0, args.seconds, stream(0, "bench"))
    command = {"q_cmd": m.q_cmd, "dq_cmd": m.dq_cmd}
    segment = Segment(control, 0.002, command, m.q_cmd, m.dq_cmd, m.q_cmd, m.time, np.arange(len(m.time)))
    nominal = [World()] * args.rows
    friction = [World().add(Placed.of("coulomb_friction", "joint4", torque=0.01 * i)) for i in range(args.rows)]
    print("| rollout | step, ms | raw, s | closed loop, s | ratio |\n|---|---|---|---|---|")
    for substeps in (1, 2, 4):
        base = raw(compiled(robot), args.rows, segment.ticks, substeps, args.threads)
        for name, worlds, along in (
            ("exact gravity", nominal, False),
            ("gravity along the motion", nominal, True),
            ("the same with dry friction", friction, True),
        ):
            begin = time.perf_counter()
            simulate(robot, worlds, [segment], h_max=0.002 / substeps, nthread=args.threads, along=along)
            spent = time.perf_counter() - begin
            print(f"| {name} | {2 / substeps:g} | {base:.2f} | {spent:.2f} | {base / spent:.2f} |", flush=True)


if __name__ == "__main__":
    main()
