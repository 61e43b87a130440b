"""Invented runs with known numbers, written as `vispeg diagnose` and `vispeg compare` write them."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vispeg.core.seeds import stream

JOINTS = tuple(f"joint{i + 1}" for i in range(7))


def example_diagnosis(verdict: str = "identified") -> dict[str, Any]:
    """A record with every key; held-out error falls 40-fold, to 1.1 floors."""
    friction = {
        "effect": "coulomb_friction",
        "where": "joint4",
        "params": {"torque": {"value": 1.3123, "low": 1.224, "high": 1.401, "unit": "N m"}},
        "indistinguishable_from": [],
    }
    payload = {
        "effect": "payload",
        "where": "flange",
        "params": {
            "mass": {"value": 0.843, "low": 0.812, "high": 0.874, "unit": "kg"},
            "z": {"value": 0.061, "low": -0.002, "high": 0.124, "unit": "m"},
        },
        "indistinguishable_from": [],
    }
    record: dict[str, Any] = {
        "format": "vispeg-diagnosis/1",
        "verdict": verdict,
        "effects": [payload, friction],
        "ladder": [
            {"model": "nominal", "fit_error": 9.1e-3, "heldout_error": 8.8e-3, "unit": "rad RMS"},
            {"model": "+ payload(flange)", "fit_error": 1.9e-3, "heldout_error": 2.1e-3, "unit": "rad RMS"},
            {"model": "+ coulomb_friction(joint4)", "fit_error": 2.1e-4, "heldout_error": 2.2e-4, "unit": "rad RMS"},
        ],
        "noise_floor": {"value": 2.0e-4, "unit": "rad RMS", "from": "repeats"},
        "where_it_fails": [
            {"joint": "joint4", "regime": "velocity reversal", "share": 0.51},
            {"joint": "joint2", "regime": "high load", "share": 0.27},
        ],
        "unexplained": None,
        "next_experiment": {
            "motion": "slow triangle on joint4, 0.02 to 0.3 rad/s",
            "why": "separates coulomb_friction(joint4) from stribeck_friction(joint4)",
            "expected_separation_sigma": 9.4,
            "file": "next/samples.csv",
        },
        "candidates": [
            {
                "effect": "viscous_friction",
                "where": "joint4",
                "heldout_gain": 0.31,
                "gain_standard_errors": 8.2,
                "rejected_because": "explains less",
            },
            {"effect": "backlash", "where": "joint2", "heldout_gain": -0.02, "rejected_because": "no held-out gain"},
            {"effect": "cogging", "where": "joint6", "heldout_gain": None, "rejected_because": "fit diverged"},
        ],
        "provenance": {
            "command": "vispeg diagnose iiwa14 --recording rig-a --recording rig-b --validate rig-c --out out",
            "seed": 0,
            "versions": {"vispeg": "0.1.0", "mujoco": "4.0.0", "numpy": "2.4.0"},
            "inputs": {"rig-a": "sha256:" + "ab" * 32, "rig-b": "sha256:" + "cd" * 32},
        },
        "recordings": {"fit": ["rig-a", "rig-b"], "validate": ["rig-c", "rig-d"]},
        "screening": [
            {"effect": "payload", "where": "flange", "score": 0.81, "cosine_group": 0},
            {"effect": "link_mass", "where": "link7", "score": 0.79, "cosine_group": 0},
            {"effect": "coulomb_friction", "where": "joint4", "score": 0.22, "cosine_group": 1},
        ],
        "shows_from": [
            {"effect": "viscous_friction", "where": "joint4", "between": {"damping": [0.0, 0.02]}},
            {"effect": "backlash", "where": "joint2", "between": {"gap": None}},
        ],
        "notes": ["rig-b: 3 rows without a reading were left out"],
        "parameters_moved": [
            {"effect": "viscous_friction", "where": "joint1", "param": "damping", "before": 0.5, "after": 0.62}
        ],
        "correlations": {
            "labels": ["payload(flange).mass", "payload(flange).z", "coulomb_friction(joint4).torque"],
            "matrix": [[1.0, -0.94, 0.1], [-0.94, 1.0, None], [0.1, None, 1.0]],
        },
    }
    if verdict == "adequate":
        record |= {"effects": [], "ladder": record["ladder"][:1], "parameters_moved": [], "correlations": None}
        record["ladder"] = [{**record["ladder"][0], "fit_error": 2.1e-4, "heldout_error": 2.1e-4}]
        record["next_experiment"] = None
    if verdict == "ambiguous":
        friction["indistinguishable_from"] = [{"effect": "stribeck_friction", "where": "joint4"}]
    if verdict == "unexplained":
        record["ladder"][-1]["heldout_error"] = 1.4e-3
        record["unexplained"] = {
            "depends_on": [{"input": "position", "joint": "joint3", "share": 0.6}, {"input": "time", "share": 0.2}],
            "text": "A periodic rest with 23 cycles a turn of joint3.",
        }
    return record


def example_evidence(
    unit: str = "rad", after: bool = True, n: int = 4000, recordings: int = 2, nj: int = 7
) -> dict[str, Any]:
    """Sinusoids with residuals of known size for the first `nj` joints; joint4 is worst."""
    rng = stream(0, "report example", unit)
    time = np.arange(n) / 500.0
    scale = 1.0 if unit == "rad" else 30.0
    arrays: dict[str, Any] = {"joints": np.array(JOINTS), "unit": np.array(unit)}
    for r in range(recordings):
        speed = 2 * np.pi * (0.15 + 0.05 * np.arange(7) + 0.02 * r)
        truth = scale * 0.5 * np.sin(np.outer(time, speed))
        size = scale * 1e-3 * np.array([2, 8, 3, 20, 2, 1, 1])
        arrays |= {
            f"{r}/name": np.array("rig-" + "cdefgh"[r]),
            f"{r}/time": time,
            f"{r}/measured": truth + scale * 2e-4 * rng.standard_normal((n, 7)),
            f"{r}/before": truth + size * np.sign(np.cos(np.outer(time, speed))),
        }
        if after:
            arrays[f"{r}/after"] = truth + 0.01 * size * np.sin(3 * np.outer(time, speed))
    for axis, edges in {
        "speed": np.linspace(-1, 1, 13),
        "load": np.linspace(-1, 1, 11),
        "position": np.linspace(-2, 2, 13),
        "phase": np.linspace(0, 1, 13),
    }.items():
        k = len(edges) - 1
        before = 1 + np.array([2, 8, 3, 40, 2, 1, 1])[:, None] * np.exp(-(np.linspace(-2, 2, k) ** 2))
        before[6, :2] = np.nan
        arrays |= {f"map/{axis}/edges": edges, f"map/{axis}/before": before}
        if after:
            arrays[f"map/{axis}/after"] = 1 + 0.02 * before
    command = 0.4 * np.sin(np.outer(time, np.array([0, 0.3, 0, 1.2, 0, 0, 0.2])))
    arrays |= {"next/time": time, "next/q_cmd": command, "next/A": command}
    arrays["next/B"] = command + 2e-3 * np.tanh(20 * np.gradient(command, axis=0))
    arrays["joints"] = arrays["joints"][:nj]
    for key, value in arrays.items():
        if value.ndim == 2:
            arrays[key] = value[:nj] if key.startswith("map/") else value[:, :nj]
    return arrays


def written(
    root: Path, record: dict[str, Any], evidence: dict[str, Any] | None = None, kind: str = "diagnosis"
) -> Path:
    """A run folder below `root`."""
    out = root / kind
    out.mkdir(exist_ok=True)
    (out / f"{kind}.json").write_text(json.dumps(record), encoding="utf-8")
    if evidence is not None:
        np.savez(out / "evidence.npz", **evidence)
    return out


@pytest.fixture
def run(tmp_path: Path):
    """Writes a run folder: `run(record, evidence, kind="diagnosis")`."""

    return partial(written, tmp_path)


@pytest.fixture
def diagnosis():
    """The example record, by verdict."""
    return example_diagnosis


@pytest.fixture
def evidence():
    """The example arrays."""
    return example_evidence
