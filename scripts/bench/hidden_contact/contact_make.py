"""Recordings of cases: the plant's motion read by imperfect sensors, in folders that do not show what is hidden."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import yaml
from arm import JOINTS
from contact_arm import HOME, joints, quaternion, turn
from contact_cases import Case
from contact_motions import LIMIT, SETS, path
from contact_plant import KD, KP, RATE, Log, Truth, held, run

NOISE = {"q": 2e-5, "dq": 1e-3, "ft": 0.2, "ft_torque": 0.01}  # rad, rad/s, N, N m
CROSS, LEVER = 0.01, 0.05  # cross-talk between channels, 1 sigma; m, ratio of a torque to a force in it
DRIFT = 0.2  # N over a recording
PATH = (3e-5, 1.1e-4)  # m: standard deviation of the flange's position error along one axis
WAVE = (0.06, 0.15)  # m: over which it changes
EE = ("x", "y", "z", "qw", "qx", "qy", "qz")
WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
ASTRAY = 0.3  # m, distance from the commanded path that only a plant that diverged reaches
TOGETHER = 160  # recordings simulated at once


def stream(*words: object) -> np.random.Generator:
    """Return the random generator that belongs to these keys."""
    text = "/".join(map(str, words)).encode()
    return np.random.default_rng(np.frombuffer(text.ljust(-(-len(text) // 4) * 4, b"."), np.uint32))


def folders(root: Path, case: Case) -> dict[str, Path]:
    """Return the folders of a case's recordings by name; the last one is judged on."""
    return {name: root / "recordings" / case.key / name for name in SETS}


def make(root: Path, chosen: list[Case], say=print) -> None:
    """Make what is not there yet; `truth.json` beside the recordings says what is hidden where."""
    lacking = [c for c in chosen if not all((f / "samples.csv").exists() for f in folders(root, c).values())]
    size = TOGETHER
    for start in range(0, len(lacking), size):
        part = lacking[start : start + size]
        for name in SETS:  # rows of one length together
            record([(c, name, folders(root, c)[name]) for c in part])
        say(f"made {min(start + size, len(lacking))}/{len(lacking)} cases")
    root.mkdir(parents=True, exist_ok=True)
    truth = {c.name: {"folder": c.key, "kind": c.kind, "hidden": c.hidden} for c in chosen}
    file = root / "truth.json"
    known = json.loads(file.read_text()) if file.exists() else {}
    part_file = file.with_suffix(".part")
    part_file.write_text(json.dumps(known | truth, indent=1))
    part_file.replace(file)


def record(wanted: list[tuple[Case, str, Path]]) -> None:
    """Simulate recordings of one name together and write them; RuntimeError, at last, where a plant diverged."""
    name = wanted[0][1]
    pos, rot = path(SETS[name])
    n = len(wanted)
    truths = [case.truth for case, *_ in wanted]
    limit = LIMIT.get(name, 25.0)
    log = run(truths, np.tile(pos, (n, 1, 1)), np.tile(rot, (n, 1, 1, 1)), np.full(n, limit))
    bad = [i for i in range(n) if not np.abs(log.pos[i] - pos).max() <= ASTRAY]  # NaN is astray, too
    for i, (case, _, folder) in enumerate(wanted):
        if i in bad:
            continue
        write(folder, name, limit, signals(log, i, case.truth, case.seed, case.name, name), (pos, rot))
    if bad:
        raise RuntimeError(f"{name} diverged: {', '.join(wanted[i][0].name for i in bad)}")


def signals(log: Log, row: int, truth: Truth, seed: int, case: str, name: str) -> dict[str, np.ndarray]:
    """Return the sensor readings of one row: q, dq (t, 7), ft (t, 6)."""
    own, common = stream(seed, case, name), stream(seed, case, "sensor")  # one robot and one sensor a case
    pos, rot = log.pos[row], log.rot[row]
    q_true = joints(pos + path_error(pos, common), rot @ turn(1e-4 * own.standard_normal((1, 3)))[0])
    q = q_true + NOISE["q"] * own.standard_normal(q_true.shape)
    dq = np.gradient(q_true, 1 / RATE, axis=0) + NOISE["dq"] * own.standard_normal(q_true.shape)
    return {"q": q, "dq": dq, "ft": wrench(log.wrench[row], truth, own, common)}


def path_error(pos: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw a smooth error (t, 3) m of the flange's measured position over the workspace, 50 to 190 um long."""
    size = np.exp(rng.uniform(*np.log(PATH)))
    out = np.zeros_like(pos)
    for axis in range(3):
        for _ in range(4):
            way = rng.standard_normal(3)
            way *= 2 * np.pi / (rng.uniform(*WAVE) * np.linalg.norm(way))
            out[:, axis] += np.sin(pos @ way + rng.uniform(0, 2 * np.pi))
    return out * size / np.sqrt(2)  # four sines of variance 1/2 each


def wrench(true: np.ndarray, truth: Truth, own: np.random.Generator, common: np.random.Generator) -> np.ndarray:
    """Return what a sensor reads of the true wrench on the tool (t, 6): late, scaled, with cross-talk, bias, drift and
    noise.

    A bias is that of the tool's wrench on the flange, as effects have it: here it is its reaction.
    """
    time = np.arange(len(true)) / RATE
    late = np.stack([np.interp(time - truth.delay, time, c) for c in true.T], axis=1)
    unit = np.array([1.0] * 3 + [LEVER] * 3)
    mix = CROSS * common.standard_normal((6, 6)) * (1 - np.eye(6)) * unit[:, None] / unit
    drift = DRIFT * own.uniform(-1, 1, 6) * unit * (time / time[-1])[:, None]
    noise = own.standard_normal(true.shape) * np.array([NOISE["ft"]] * 3 + [NOISE["ft_torque"]] * 3)
    return truth.gain * late @ (np.eye(6) + mix).T - np.array(truth.bias) + drift + noise


def write(folder: Path, motion: str, limit: float, signals: dict[str, np.ndarray], command: tuple) -> None:
    """Write a folder with recording.yaml and samples.csv; replace an older one in a single rename."""
    mass, com, inertia = held(Truth())
    inertia = inertia - mass * (com @ com * np.eye(3) - np.outer(com, com))
    head = {
        "format": "vispeg-recording/1",
        "robot": "iiwa14",
        "joints": list(JOINTS),
        "rate_hz": RATE,
        "control": {
            "mode": "osc",
            "rate_hz": RATE,
            "gravity_compensation": "model",
            "kp": KP.tolist(),
            "kd": KD.tolist(),
            "nullspace": {"kp": 20.0, "kd": 8.94, "q": HOME.tolist()},
            "force_limit_n": limit,
        },
        "tool": {
            "name": "meg50+peg16",
            "mass_kg": float(mass),
            "com_m": com.tolist(),
            "inertia_kgm2": np.diag(inertia).tolist(),
        },
        "base": {"tilt_rad": [0, 0]},
        "torque_sensor": "none",
        "cell": "nominal",
        "wrench": {"frame": "flange", "acts_on": "tool", "tared": False},
        "noise": NOISE,
        "motion": motion,
    }
    signals = signals | {"ee_cmd": np.concatenate([command[0], quaternion(command[1])], axis=1)}
    tails = {"ee_cmd": EE, "ft": WRENCH}
    names = ["time", *(f"{key}.{tail}" for key in signals for tail in tails.get(key, JOINTS))]
    time = np.arange(len(signals["q"])) / RATE
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    (part / "recording.yaml").write_text(yaml.safe_dump(head, sort_keys=False))
    table = np.column_stack([time, *signals.values()])
    np.savetxt(part / "samples.csv", table, "%.9g", ",", header=",".join(names), comments="")
    shutil.rmtree(folder, ignore_errors=True)
    os.replace(part, folder)
