#!/usr/bin/env python3
"""Makes a long recording, on which reading, `check`, `compare` and `diagnose` can be timed.

    python scripts/bench/long_recording.py --minutes 30 --rate 1000 --joints 7 --out long
    /usr/bin/time -v vispeg check long

With seven joints the robot is an iiwa14, so that `compare` has a model: long rests and slow moves with a few fast ones,
as in pick and place. With another number it is a chain of that many links, whose URDF is written too.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from vispeg.recordings.recording import Control, Recording
from vispeg.recordings.write import write

REST = np.array([0.0, 0.5, 0.0, -1.2, 0.0, 0.9, 0.0])
NOISE = {"q": 2e-5, "tau": 0.2}
GAINS = (400.0, 600.0, 150.0, 300.0, 30.0, 40.0, 4.0), (20.0, 50.0, 5.0, 15.0, 0.6, 0.7, 0.06)  # N m/rad, N m s/rad


def moves(time: np.ndarray, nj: int, rng: np.random.Generator) -> np.ndarray:
    """Return angles (n, nj) rad: minimum-jerk moves between random places, most of them slow, with rests between."""
    knots, places = [0.0], [np.zeros(nj)]
    while knots[-1] < time[-1]:
        knots.append(knots[-1] + rng.uniform(1.0, 8.0))
        places.append(places[-1])
        fast = rng.random() < 0.15
        knots.append(knots[-1] + (rng.uniform(0.8, 1.2) if fast else rng.uniform(4.0, 12.0)))
        places.append(rng.uniform(-0.35, 0.35, nj))
    at = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, len(knots) - 2)
    u = (time - np.take(knots, at)) / (np.take(knots, at + 1) - np.take(knots, at))
    s = (10 * u**3 - 15 * u**4 + 6 * u**5)[:, None]
    return np.array(places)[at] * (1 - s) + np.array(places)[at + 1] * s


def chain(file: Path, nj: int) -> tuple[str, ...]:
    """Write a URDF of nj links in a row; return the joints' names."""
    names = tuple(f"j{i + 1}" for i in range(nj))
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    links = "".join(f'<link name="l{i}"><inertial><mass value="1"/>{inertia}</inertial></link>' for i in range(nj + 1))
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0 0.1"/>'
        f'<axis xyz="0 {(i + 1) % 2} {i % 2}"/><limit lower="-3" upper="3" velocity="3" effort="100"/></joint>'
        for i, name in enumerate(names)
    )
    file.write_text(f'<robot name="chain">{links}{joints}</robot>\n', encoding="utf-8")
    return names


def main() -> int:
    """Write the folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--joints", type=int, default=7)
    parser.add_argument("--table", choices=("csv", "parquet"), default="csv")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    time = np.arange(round(60 * args.minutes * args.rate)) / args.rate
    arm = args.joints == 7
    args.out.parent.mkdir(parents=True, exist_ok=True)
    robot = "iiwa14" if arm else str((args.out.parent / f"{args.out.name}.urdf").resolve())
    joints = tuple(f"joint{i + 1}" for i in range(7)) if arm else chain(Path(robot), args.joints)
    q_cmd = moves(time, args.joints, rng) + (REST if arm else 0.0)
    lag = 0.02 * np.gradient(q_cmd, time, axis=0)
    tau = 5.0 * np.sin(q_cmd) + 0.4 * np.tanh(lag / 1e-4)
    rec = Recording(
        path=args.out, robot=robot, joints=joints, rate_hz=args.rate,
        control=Control("position", args.rate, "model", *(np.resize(gain, args.joints) for gain in GAINS)),
        time=time, q_cmd=np.round(q_cmd, 7), q=np.round(q_cmd - lag + NOISE["q"] * rng.standard_normal(q_cmd.shape), 7),
        tau=np.round(tau + NOISE["tau"] * rng.standard_normal(tau.shape), 4), torque_sensor="joint", noise=NOISE,
        motion="pick and place",
    )  # fmt: skip
    write(rec, args.out, overwrite=True, table=args.table)
    size = sum(f.stat().st_size for f in args.out.iterdir())
    print(f"{args.out}: {len(time)} rows of {args.joints} joints, {size / 1e6:.0f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
