"""Recordings made up for the tests: known motion, known noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vispeg.recordings.recording import Control, Recording


def recording(n: int = 500, rate_hz: float = 500.0, mode: str = "position", **changes) -> Recording:
    """Two joints on sines; torque, command, pose and wrench channels filled with numbers that have no short text."""
    rng = np.random.default_rng(7)
    time = np.arange(n) / rate_hz
    q = np.stack([0.8 * np.sin(2 * np.pi * 0.5 * time), 0.4 * np.cos(2 * np.pi * 1.1 * time)], 1)
    pose = rng.normal(size=(n, 7))
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    size = 6 if mode == "osc" else 2
    fields = {
        "path": Path("made-up"),
        "robot": "iiwa14",
        "joints": ("joint1", "joint2"),
        "rate_hz": rate_hz,
        "control": Control(mode, rate_hz, "model", np.full(size, 300 / 7), np.full(size, 0.1)),
        "time": time,
        "q": q + rng.normal(scale=1e-5, size=q.shape),
        "dq": rng.normal(size=q.shape),
        "tau": rng.normal(size=q.shape) / 3,
        "tau_cmd": rng.normal(size=q.shape) * 1e-9,
        "q_cmd": q,
        "ee": pose,
        "ee_cmd": pose,
        "ft": rng.normal(size=(n, 6)) * 1e7,
        "torque_sensor": "joint",
        "noise": {"q": 1e-5, "tau": 0.2},
        "motion": "sines",
    }
    return Recording(**(fields | changes))
