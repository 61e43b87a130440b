"""Measure the cost of a diagnosis: wall and processor seconds, memory, growth with recordings and candidates.

    python scripts/bench/diagnosis.py [--seconds 10] [--threads 2] [--only-growth]

The diagnosis is `vispeg diagnose` in a process of its own: two recordings fitted, one held out, two effects hidden,
all effects and joints searched. Growth is measured on what nearly all its time goes to: closed-loop residuals of
candidate worlds.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import motion
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.noise import NOISE
from vispeg.recordings.recording import Recording
from vispeg.recordings.write import write
from vispeg.robots.model import load
from vispeg.worlds.world import World

HIDDEN = World().add(
    EffectInstance.of("coulomb_friction", "joint4", torque=1.2), EffectInstance.of("joint_bias", "joint2", torque=1.0)
)


def recordings(count: int, seconds: float) -> list[Recording]:
    """Record Fourier motions of the arm with the hidden effects, 500 Hz, position controlled."""
    robot = load("iiwa14")
    control, out = controller(robot, "position", 500.0, centre_of(robot)), []
    for i in range(count):
        m = motion("fourier", robot, 500.0, seconds, stream(i, "bench", "motion"))
        out.append(record(HIDDEN, m, control, NOISE, stream(i, "bench", "noise"), name=f"rec-{i}"))
    return out


def whole(recs: list[Recording], threads: int) -> None:
    """Print the cost of a whole diagnosis; the last recording is held out."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [write(rec, Path(folder) / rec.name) for rec in recs]
        told = [f"--recording={p}" for p in paths[:-1]] + [f"--validate={paths[-1]}"]
        out = Path(folder) / "found"
        command = [sys.executable, "-m", "vispeg", "diagnose", "iiwa14", *told, f"--out={out}", "--quiet"]
        begin = time.perf_counter()
        subprocess.run([*command, f"--threads={threads}"], check=True, stdout=subprocess.DEVNULL)
        wall, used = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
        found = json.loads((out / "diagnosis.json").read_text())
    names = " + ".join(f"{e['effect']}({e['where']})" for e in found["effects"])
    print("| recordings | wall, s | processor, s | peak memory, GiB | verdict |\n|---|---|---|---|---|")
    length = f"{len(recs)} of {recs[0].time[-1]:.3g} s"
    spent = f"{wall:.1f} | {used.ru_utime + used.ru_stime:.1f} | {used.ru_maxrss / 2**20:.2f}"
    print(f"| {length} | {spent} | {found['verdict']}: {names} |\n", flush=True)


def growth(recs: list[Recording]) -> None:
    """Print processor seconds of residuals by candidates and by recordings."""
    print("| recordings | candidates | processor, s | ms a candidate and recording |\n|---|---|---|---|")
    for count, candidates in ((1, 8), (1, 64), (4, 32)):
        evidence = Evidence(recs[:count])
        level = 2.0 * np.arange(1, candidates + 1) / candidates
        worlds = [World().add(EffectInstance.of("viscous_friction", "joint4", damping=x)) for x in level]
        evidence.residuals(worlds[:8])  # what is computed once a recording
        begin = time.process_time()
        evidence.residuals(worlds)
        spent = time.process_time() - begin
        print(f"| {count} | {candidates} | {spent:.2f} | {1e3 * spent / candidates / count:.1f} |", flush=True)


def main() -> None:
    """Print Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--only-growth", action="store_true")
    args = parser.parse_args()
    recs = recordings(4, args.seconds)
    if not args.only_growth:
        whole(recs[:3], args.threads)
    growth(recs)


if __name__ == "__main__":
    main()
