"""Import a NumPy archive with arrays `time` (n,), `q` (n, nj), and optionally further signals of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.arrays import read_arrays
from vispeg.recordings.columns import SIGNALS, columns_of
from vispeg.recordings.importers.build import build, joints_of, si
from vispeg.recordings.importers.clock import counted
from vispeg.recordings.importers.mapping import ColumnMap, Source
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.table import MAX_BYTES


def import_npz(source: Path, robot: str, joints: Sequence[str], mapping: ColumnMap | None = None) -> Recording:
    """Import a recording from an .npz file; nothing in it is ever unpickled.

    Arrays are `time`, `episode` (n,), `q`, `dq`, `tau`, `tau_cmd`, `q_cmd`, `dq_cmd` (n, nj), `ee`, `ee_cmd` (n, 7),
    `ft` (n, 6), and `joints` (nj,), the joint names of the arrays' columns. The map may state other names; see
    `ColumnMap.by_own_name` for arrays that it does not name.

    Args:
        source: the .npz file.
        robot: a name or a path.
        joints: the robot's joints; an array `joints` in the archive overrides them.
        mapping: names and units of the arrays.

    Raises:
        UserError: the file is damaged, an array has the wrong shape or kind, the map names parts of arrays, or the
            recording would not pass `load`.
    """
    mapping = mapping or ColumnMap()
    arrays = read_arrays(source, most=MAX_BYTES)
    named = arrays.get("joints")
    if named is not None and "joints" not in mapping.recording:
        joints = [str(name) for name in np.atleast_1d(named)]
    names = joints_of(joints, mapping)
    whole = ("time", "episode", *SIGNALS, *mapping.own)
    for target in mapping.columns:
        if target not in whole:
            raise UserError("names no whole array", file=mapping.file, key=target, choices=whole)
    columns: dict[str, np.ndarray] = {}
    rows: int | None = None
    own = mapping.by_own_name(whole)
    for target in whole:
        origin = mapping.columns.get(target, Source(target))
        needed = target in mapping.columns or target == "q" or (target == "time" and mapping.rate_hz is None)
        if not needed and (target not in own or origin.name not in arrays):
            continue
        tails = [target] if target in ("time", "episode") else columns_of(target, names)
        values = _summed(arrays, origin, target, rows, len(tails), source)
        rows = len(values)
        columns |= dict(zip(tails, values.T, strict=True))
    if mapping.rate_hz is not None:
        columns["time"] = counted(columns.get("episode"), rows or 0, mapping.rate_hz, source, arrays)
    return build(columns, source, robot, joints, mapping)


def _summed(
    arrays: Mapping[str, Any], origin: Source, target: str, rows: int | None, width: int, source: Path
) -> np.ndarray:
    """Return an array (rows, width) in SI units: the source's array plus the further arrays in the map's `plus`."""
    if origin.name not in arrays:
        raise UserError("no such array", file=source, key=target, got=origin.name, choices=arrays)
    values = _numbers(arrays[origin.name], origin.name, source)
    values = values.reshape(-1, 1) if values.ndim == 1 and width == 1 else values
    shape = (len(values) if rows is None else rows, width)
    if values.shape != shape:
        raise UserError("has the wrong shape", file=source, key=origin.name, expected=shape, got=values.shape)
    terms = (_summed(arrays, term, target, shape[0], width, source) for term in origin.plus)
    return sum(terms, start=si(values, origin))


def _numbers(array: np.ndarray, name: str, source: Path) -> np.ndarray:
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiub":
        raise UserError("is not numeric", file=source, key=name, got=str(getattr(array, "dtype", type(array).__name__)))
    return np.atleast_1d(array.astype(float))
