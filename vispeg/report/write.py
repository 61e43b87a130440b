"""Write the folder of a result: record, arrays, model, next motion, report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.report.build import write_report
from vispeg.worlds.model_file import write_model
from vispeg.worlds.world import World


def write_diagnosis(folder: Path, record: Mapping[str, object], world: World, arrays: Mapping[str, np.ndarray]) -> None:
    """Write `diagnosis.json`, `evidence.npz`, `model.yaml`, `report.html` and the next motion into an empty folder."""
    write_json(folder / "diagnosis.json", record)
    write_model(folder / "model.yaml", world)
    _write_arrays(folder / "evidence.npz", arrays)
    if "next/q_cmd" in arrays:
        _write_motion(folder / "next_experiment", arrays)
    write_report(folder)


def write_comparison(folder: Path, record: Mapping[str, object], arrays: Mapping[str, np.ndarray]) -> None:
    """Write `compare.json`, `evidence.npz` and `report.html` into an empty folder."""
    write_json(folder / "compare.json", record)
    _write_arrays(folder / "evidence.npz", arrays)
    write_report(folder)


def write_fit(folder: Path, record: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Write `fit.json`, `report.html` and, if there are arrays, `evidence.npz` into an empty folder."""
    write_json(folder / "fit.json", record)
    if arrays:
        _write_arrays(folder / "evidence.npz", arrays)
    write_report(folder)


def write_json(path: Path, record: Mapping[str, object]) -> None:
    """Write a record as JSON; numbers that are not finite become null."""
    path.write_text(json.dumps(finite(record), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays; those of float64 with two or more axes as float32, to save space.

    Arrays of the next motion stay float64: the difference of two similar predictions must not be rounding error.
    """
    large = {k for k, v in arrays.items() if v.dtype == np.float64 and v.ndim > 1 and not k.startswith("next/")}
    named = {k: v.astype(np.float32) if k in large else v for k, v in arrays.items()}
    np.savez_compressed(path, **named)  # pyright: ignore[reportArgumentType]  # no array is called allow_pickle


def _write_motion(folder: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write the motion (s, rad, rad/s) as a table that `vispeg record --motion FILE` and a robot can replay."""
    folder.mkdir()
    joints = [str(j) for j in arrays["joints"]]
    columns = ["time", *(f"q_cmd.{j}" for j in joints), *(f"dq_cmd.{j}" for j in joints)]
    values = np.column_stack([arrays["next/time"], arrays["next/q_cmd"], arrays["next/dq_cmd"]])
    np.savetxt(folder / "samples.csv", values, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")


def finite(value: Any) -> Any:
    """Return a value of plain types for JSON, with None in place of NaN and infinity, which JSON lacks."""
    if isinstance(value, Mapping):
        return {str(k): finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [finite(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value
