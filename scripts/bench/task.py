"""Measure the speed of the task, in simulated seconds per CPU second, and that of raw physics and of robosuite.

    python scripts/bench/task.py [--rows 1 4 16 64] [--seconds 8] [--images] [--robosuite PATH_TO_ITS_PYTHON]

Ours: `PegInHoleVec` with state observations under random actions that lean downwards, so that pegs touch, enter and
end their episodes; resets count. Raw: `mujoco.batch` alone on the same compiled cells, from the same states, stepped as
often with the torques that the task's controller gave, held over each control period. Everything is on one thread and
in CPU time, which other programs do not lengthen by taking turns.

robosuite (its own Python, where it is installed): `Lift` with its IIWA under its OSC_POSE controller, state
observations, no cameras, the same policy period, random actions that lean downwards. It steps by 2 ms and computes its
control law at each of them. With `--images` both sides also see RGB and depth of 64 x 64 px from the wrist at every
policy step, each as its defaults draw them, and there is no raw side.

`bound`, from the same run, is how fast the task would be if nothing took time but MuJoCo itself, its
physics steps, the kinematics and inertia of the controller's own model and, with `--images`, its drawing.
"""

from __future__ import annotations

import argparse
import subprocess
import time
from typing import Any

import mujoco
import numpy as np
from mujoco import batch as mjb

from vispeg.core.seeds import stream
from vispeg.sim.quiet import quiet
from vispeg.task.peg.task import PegInHoleVec

LEAN = 0.3  # of the random actions, downwards
ROBOSUITE = """
import sys, time, warnings
warnings.filterwarnings("ignore")
import numpy as np
import robosuite
from robosuite.controllers import load_composite_controller_config
config = load_composite_controller_config(controller="BASIC", robot="IIWA")
images = sys.argv[2] == "images"
seen = dict(camera_names="robot0_eye_in_hand", camera_heights=64, camera_widths=64, camera_depths=True)
seen = seen if images else {}
env = robosuite.make("Lift", robots="IIWA", controller_configs=config, has_renderer=False, use_object_obs=True,
    has_offscreen_renderer=images, use_camera_obs=images, control_freq=6.25, horizon=50, seed=0, **seen)
rng = np.random.default_rng(0)
env.reset()
for _ in range(3):  # numba compiles what it meets first
    env.step(np.zeros(env.action_dim))
spent, simulated = 0.0, 0.0
while spent < float(sys.argv[1]):
    begin = time.process_time()
    for _ in range(5):
        action = rng.uniform(-1, 1, env.action_dim)
        action[2] -= LEAN
        done = env.step(np.clip(action, -1, 1))[2]
        simulated += 0.16
        if done:
            env.reset()
    spent += time.process_time() - begin
part = config["body_parts"]["right"]["type"]
print("RESULT", simulated / spent, part, robosuite.__version__, env.sim.model.opt.timestep)
""".replace("LEAN", str(LEAN))


class Beneath:
    """CPU time (s) that MuJoCo itself takes while the task runs."""

    def __init__(self, env: PegInHoleVec, images: bool):
        self.spent = 0.0
        self.watch(env.sim.cell.batch, "step")
        self.watch(env.sim.control.nominal.batch, "forward")
        for name in ("mjr_render", "mjr_readPixels", "mjv_updateScene") if images else ():
            self.watch(mujoco, name)

    def watch(self, owner: Any, name: str) -> None:
        """Count every call of `owner.name` from now on."""
        function = getattr(owner, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            began = time.process_time()
            out = function(*args, **kwargs)
            self.spent += time.process_time() - began
            return out

        setattr(owner, name, timed)


class Tape:
    """Torques of every control tick and states at every policy step, as the task runs."""

    def __init__(self, env: PegInHoleVec):
        self.cell, self.states, self.torques = env.sim.cell, [], []
        advance = self.cell.advance

        def record(command: np.ndarray, nsub: int) -> None:
            self.torques.append(command.copy())
            advance(command, nsub)

        self.cell.advance = record

    def mark(self) -> None:
        """Store the states at the beginning of a policy step."""
        self.states.append((self.cell.qpos.copy(), self.cell.qvel.copy()))


def actions(rows: int, steps: int) -> np.ndarray:
    """Return (steps, rows, 3) in [-1, 1]."""
    out = stream(0, "bench", rows).uniform(-1, 1, (steps, rows, 3))
    return np.clip(out - [0, 0, LEAN], -1, 1)


def task(world: str, rows: int, seconds: float, images: bool) -> tuple[float, float, float]:
    """Return CPU seconds per simulated second of one row: the task's, raw physics' on the same path, MuJoCo's own.

    The second is nan with images.
    """
    seen: dict[str, Any] = {"obs_mode": "rgbd", "cameras": ("wrist_wide",), "image_size": 64} if images else {}
    env = PegInHoleVec(rows, world=world, **seen)
    env.reset(seed=0)
    beneath, length = Beneath(env, images), 0
    spent, simulated = 0.0, 0.0
    while spent < seconds:
        begin = time.process_time()
        for action in actions(rows, 10):
            env.step(action)
        spent += time.process_time() - begin
        simulated += 10 * rows * env.config.policy_period
        length += 10
    least = beneath.spent / simulated
    if images:
        return spent / simulated, float("nan"), least
    # the same again, recorded: equal seeds give equal paths
    env.reset(seed=0)
    tape = Tape(env)
    for _ in range(length // 10):
        for action in actions(rows, 10):
            tape.mark()
            env.step(action)
    return spent / simulated, raw(env, tape) / simulated, least


def raw(env: PegInHoleVec, tape: Tape) -> float:
    """Return the CPU seconds of `mujoco.batch` for what the tape holds."""
    cell, c = env.sim.cell, env.config
    batch = mjb.Batch(cell.model, env.num_envs, nthread=1)
    for name in expanded(cell.batch):
        batch.expand(name)[:] = cell.batch.expanded(name)
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    spent = 0.0
    with quiet():  # as the task runs: without MuJoCo's profiler
        for i, state in enumerate(tape.states):
            qpos[:], qvel[:] = state
            for k in range(c.ticks):
                torque = tape.torques[i * c.ticks + k]
                begin = time.process_time()
                ctrl[:, cell.u] = torque
                batch.step(nstep=c.substeps)
                spent += time.process_time() - begin
    return spent


def expanded(batch: Any) -> list[str]:
    """List the model fields that differ from row to row."""
    names = [*mjb.MODEL_FIELDS, *(f"opt.{n}" for n in ("timestep", "gravity", "iterations", "impratio"))]
    found = []
    for name in names:
        try:
            found += [name] if batch.expanded(name) is not None else []
        except (KeyError, ValueError, AttributeError):
            continue
    return found


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, nargs="+", default=[1, 4, 16, 64])
    parser.add_argument("--seconds", type=float, default=8.0, help="CPU seconds for each line")
    parser.add_argument("--worlds", nargs="+", default=["nominal", "randomized"])
    parser.add_argument("--images", action="store_true", help="see RGB-D of 64 x 64 px as well")
    parser.add_argument("--robosuite", help="a Python that has robosuite 1.5")
    args = parser.parse_args()
    other = None
    if args.robosuite:
        command = [args.robosuite, "-c", ROBOSUITE, str(args.seconds), "images" if args.images else "state"]
        answer = subprocess.run(command, capture_output=True, text=True, check=True)
        line = next(x for x in answer.stdout.splitlines() if x.startswith("RESULT")).split()
        other = float(line[1])
        print(f"robosuite {line[3]}, Lift, IIWA, {line[2]}, steps of {float(line[4]):g} s: {other:.2f} simulated s/s\n")
    if args.images:
        print("| world | rows | task, simulated s/s | bound |\n|---|---|---|---|")
    else:
        print("| world | rows | task, simulated s/s | bound | raw physics | share of raw |\n|---|---|---|---|---|---|")
    for world in args.worlds:
        for rows in args.rows:
            ours, physics, least = task(world, rows, args.seconds, args.images)
            speeds = [f"{1 / s:.1f}" + (f" ({1 / s / other:.0f}x)" if other else "") for s in (ours, least)]
            bare = [] if args.images else [f"{1 / physics:.1f}", f"{physics / ours:.2f}"]
            print("|", " | ".join([world, str(rows), *speeds, *bare]), "|", flush=True)


if __name__ == "__main__":
    main()
