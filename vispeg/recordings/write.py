"""Write a recording folder that `load` reads back bit for bit."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.paths import expanded
from vispeg.recordings.cell import Outcome
from vispeg.recordings.columns import SIGNALS, columns_of
from vispeg.recordings.frames.files import write_frames
from vispeg.recordings.recording import Control, Recording
from vispeg.recordings.schema import FORMAT

BLOCK = 4096  # rows of text in memory at once


def write(
    recording: Recording,
    folder: Path | str,
    overwrite: bool = False,
    table: Literal["csv", "parquet"] = "csv",
    inputs: Iterable[str | Path | None] = (),
) -> Path:
    """Write recording.yaml, the samples and the frames; the folder appears whole or not at all.

    Args:
        recording: what to write; numbers are written so that reading gives the same bits, NaN as an empty cell.
        folder: where to; a `robot` that is an absolute path is written relative to it.
        overwrite: whether an existing folder with content is replaced.
        table: the format of the samples.
        inputs: files and folders that the recording was made from, none of which is replaced.

    Returns:
        The folder.

    Raises:
        UserError: the folder exists already or cannot be written, or an array does not have one row per sample.
    """
    target = expanded(folder)
    with new_folder(folder, overwrite, holds="recording", inputs=(recording.robot, *inputs)) as part:
        fill(part, recording, target, table)
    return target


def fill(part: Path, recording: Recording, target: Path, table: Literal["csv", "parquet"] = "csv") -> None:
    """Write the files of a recording into the folder `part`, which will be called `target`. Raises as `write`."""
    samples = _samples(recording)
    text = yaml.safe_dump(_header(recording, target), sort_keys=False, allow_unicode=True, width=120)
    (part / "recording.yaml").write_text(text, encoding="utf-8")
    if table == "csv":
        write_csv(part / "samples.csv", samples)
    else:
        _write_parquet(part / "samples.parquet", samples)
    if recording.frames is not None and len(recording.frames):
        write_frames(recording.frames, part, episodes=recording.episode is not None)


def _samples(rec: Recording) -> dict[str, np.ndarray]:
    columns = {"time": rec.time}
    if rec.episode is not None:
        columns["episode"] = np.asarray(rec.episode, np.int64)
    declared = {name: signal.values for name, signal in rec.signals.items()}
    for signal, values in ({name: getattr(rec, name) for name in SIGNALS} | declared).items():
        if values is None:
            continue
        names = columns_of(signal, rec.joints)
        if values.shape != (len(rec.time), len(names)):
            raise UserError(
                "has the wrong shape", file=rec.path, key=signal, expected=(len(rec.time), len(names)), got=values.shape
            )
        columns |= dict(zip(names, values.T, strict=True))
    return columns


def write_csv(file: Path, columns: dict[str, np.ndarray]) -> None:
    """Write columns as a table. `repr` of a float is the shortest text that reads back to the same bits."""
    rows = len(columns["time"])
    with file.open("w", encoding="utf-8", newline="") as stream:
        stream.write(",".join(columns) + "\n")
        for start in range(0, rows, BLOCK):
            block = [column[start : start + BLOCK].tolist() for column in columns.values()]
            texts = [["" if v != v else repr(v) for v in column] for column in block]
            stream.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))


def _write_parquet(file: Path, columns: dict[str, np.ndarray]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({name: np.ascontiguousarray(values) for name, values in columns.items()}), file)


def _header(rec: Recording, folder: Path) -> Mapping[str, object]:
    head: dict[str, object] = {
        "format": FORMAT,
        "robot": _relative(rec.robot, folder),
        "joints": list(rec.joints),
        "rate_hz": float(rec.rate_hz),
        "control": _control(rec.control),
        "base": {"tilt_rad": [float(angle) for angle in rec.base_tilt]},
        "torque_sensor": rec.torque_sensor,
    }
    if rec.tool is not None or rec.control.mode != "unknown":  # else the tool is not known either
        head["tool"] = _plain(rec.tool) if rec.tool is not None else "none"
    if rec.noise:
        head["noise"] = _plain(rec.noise)
    if rec.cell is not None:
        head["cell"] = _plain(replace(rec.cell, world=_relative(rec.cell.world, folder)).plain())
    if rec.wrench is not None:
        sensor = {key: _plain(value) for key, value in asdict(rec.wrench).items()}
        head["wrench"] = {"pos_m" if key == "pos" else key: value for key, value in sensor.items()}
    if rec.outcomes:
        head["outcome"] = [_outcome(outcome) for outcome in rec.outcomes]
    if rec.signals:
        head["signals"] = {k: {"unit": s.unit, **_stated(s.noise)} for k, s in rec.signals.items()}
    return head | {"motion": rec.motion, "notes": rec.notes}


def _stated(noise: float | None) -> Mapping[str, float]:
    return {} if noise is None else {"noise": float(noise)}


def _outcome(outcome: Outcome) -> Mapping[str, object]:
    head: dict[str, object] = {"episode": int(outcome.episode), "success": bool(outcome.success)}
    head |= {"category": outcome.category} if outcome.category else {}
    numbers = {"peak_force_n": outcome.peak_force, "depth_m": outcome.depth}
    return head | {key: float(value) for key, value in numbers.items() if value is not None}


def _relative(path: str, folder: Path) -> str:
    """Return an absolute path relative to `folder`, and any other text unchanged."""
    if not os.path.isabs(path):
        return path
    relative = os.path.relpath(os.path.realpath(path), os.path.realpath(folder))
    return relative if "/" in relative or "." in relative else path  # a bare word would be read as a name


def _control(control: Control) -> Mapping[str, object]:
    out: dict[str, object] = {"mode": control.mode, "rate_hz": float(control.rate_hz)}
    if control.mode != "unknown" or control.gravity_compensation != "none":
        out["gravity_compensation"] = control.gravity_compensation
    out |= {name: _plain(gains) for name in ("kp", "kd") if (gains := getattr(control, name)) is not None}
    if control.nullspace is not None:
        null = control.nullspace
        out["nullspace"] = {"kp": float(null.kp), "kd": float(null.kd), "q": _plain(null.q)}
    if control.force_limit is not None:
        out["force_limit_n"] = float(control.force_limit)
    if control.torque_limit is not None:
        out["torque_limit_nm"] = _plain(control.torque_limit)
    return out


def _plain(value: Any) -> Any:
    """Convert NumPy values, tuples and mappings to plain types for YAML; containers are copied, so none is aliased."""
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
