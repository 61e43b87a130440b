"""Import a NumPy archive with arrays `time` (n,), `q` (n, nj), and optionally further signals of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.arrays import read_arrays
from vispeg.recordings.columns import SIGNALS, columns_of
from vispeg.recordings.importers.build import build, joints_of, si
from vispeg.recordings.importers.mapping import ColumnMap, Source
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.table import MAX_BYTES


def import_npz(
    source: Path, robot: str, joints: Sequence[str], mapping: ColumnMap | None = None, **header: Any
) -> Recording:
    """Import a recording from an .npz file; nothing in it is ever unpickled.

    Arrays are `time`, `episode` (n,), `q`, `dq`, `tau`, `tau_cmd`, `q_cmd`, `dq_cmd` (n, nj), `ee`, `ee_cmd` (n, 7),
    `ft` (n, 6), under these names or those in the map, and `joints` (nj,), the joint names of the arrays' columns.

    Args:
        source: the .npz file.
        robot: a name or a path.
        joints: the robot's joints; an array `joints` in the archive overrides them.
        mapping: names and units of the arrays.
        header: further keys of recording.yaml.

    Raises:
        UserError: the file is damaged, an array has the wrong shape or kind, or the recording would not pass `load`.
    """
    mapping = mapping or ColumnMap()
    arrays = read_arrays(source, most=MAX_BYTES)
    named = arrays.get("joints")
    if named is not None and "joints" not in mapping.recording:
        joints = [str(name) for name in np.atleast_1d(named)]
    names = joints_of(joints, mapping)
    columns: dict[str, np.ndarray] = {}
    for target in ("time", "episode", *SIGNALS):
        origin = mapping.columns.get(target, Source(target))
        if origin.name not in arrays:
            if target in mapping.columns or target in ("time", "q"):
                raise UserError("no such array", file=source, key=target, got=origin.name, choices=arrays)
            continue
        values = _numbers(arrays[origin.name], origin.name, source)
        tails = [target] if target in ("time", "episode") else columns_of(target, names)
        values = values.reshape(-1, 1) if values.ndim == 1 and len(tails) == 1 else values
        rows = len(columns["time"]) if columns else len(values)
        if values.shape != (rows, len(tails)):
            shape = (rows, len(tails))
            raise UserError("has the wrong shape", file=source, key=origin.name, expected=shape, got=values.shape)
        columns |= dict(zip(tails, si(values, origin).T, strict=True))
    return build(columns, source, robot, joints, mapping, **header)


def _numbers(array: np.ndarray, name: str, source: Path) -> np.ndarray:
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiub":
        raise UserError("is not numeric", file=source, key=name, got=str(getattr(array, "dtype", type(array).__name__)))
    return np.atleast_1d(array.astype(float))
