"""Writes a recording folder (docs/formats.md) without the project's own writer, and with no hint of what is hidden."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import yaml
from arm import JOINTS
from loop import GAINS, NOISE, NULLSPACE, RATE

EE = ("x", "y", "z", "qw", "qx", "qy", "qz")


def write(folder: Path, time: np.ndarray, mode: str, motion: str, signals: dict[str, np.ndarray]) -> None:
    """Write a folder with recording.yaml and samples.csv; replace an older one of its name in a single rename."""
    law = "position" if mode == "soft" else mode
    control: dict = {"mode": law, "rate_hz": RATE, "gravity_compensation": "model"}
    if mode != "torque":
        control |= {"kp": GAINS[mode][0], "kd": GAINS[mode][1]}
    if mode == "osc":
        control["nullspace"] = {"kp": NULLSPACE[0], "kd": NULLSPACE[1], "q": [float(x) for x in NULLSPACE[2]]}
    head = {
        "format": "vispeg-recording/1", "robot": "iiwa14", "joints": list(JOINTS), "rate_hz": RATE, "control": control,
        "tool": "none", "base": {"tilt_rad": [0, 0]}, "torque_sensor": "joint", "noise": NOISE, "motion": motion,
    }  # fmt: skip
    names, columns = ["time"], [time[:, None]]
    for key, value in signals.items():
        names += [f"{key}.{tail}" for tail in (EE if key == "ee_cmd" else JOINTS)]
        columns.append(value)
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    (part / "recording.yaml").write_text(yaml.safe_dump(head, sort_keys=False))
    np.savetxt(part / "samples.csv", np.hstack(columns), "%.9g", ",", header=",".join(names), comments="")
    shutil.rmtree(folder, ignore_errors=True)
    os.replace(part, folder)
