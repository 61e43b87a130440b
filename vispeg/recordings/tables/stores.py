"""Read files of named arrays as tables: HDF5, MATLAB, NumPy, JSON and JSON lines.

An array (n,) becomes a column of its name, an array (n, k) the columns `name[0]` to `name[k-1]`; n is the length of the
arrays that hold the most numbers. Groups called `demo_3`, `episode_0` or `traj_1` are episodes and are concatenated.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.extras import missing
from vispeg.formats.arrays import read_arrays
from vispeg.formats.guard import opened, read_text
from vispeg.formats.json_data import parse_json, read_json
from vispeg.recordings.tables.table import MAX_BYTES, Reading, Table, check_rows, checked_names

WIDEST = 64  # most columns of one array; wider ones are pictures or point clouds
EPISODE = re.compile(r"(demo|episode|traj|trajectory|run|trial)_?(\d+)", re.IGNORECASE)
EPISODES = "episode"  # the column with the episode's number
MOST_TEXT = 256_000_000  # bytes of JSON


def read_store(file: Path, reading: Reading) -> Table:
    """Read a file of arrays as a table. Raises UserError: damaged, or without arrays of samples."""
    arrays = READERS[file.suffix.lower()](file)
    columns = columns_from(arrays, file)
    if reading.dialect.names and "" in arrays:
        if len(reading.dialect.names) != len(columns):
            got = f"{len(reading.dialect.names)} names"
            raise UserError("has another number of columns", file=file, key="--columns", expected=len(columns), got=got)
        columns = dict(zip(reading.dialect.names, columns.values(), strict=True))
    rows = len(next(iter(columns.values())))
    check_rows(rows, file)
    names = checked_names(list(columns), file)
    kept = {name: columns[name] for name in reading.retained(names)}
    return Table(file, kept, names, rows, range(rows))


def columns_from(arrays: Mapping[str, np.ndarray], file: Path) -> dict[str, np.ndarray]:
    """Make columns (n,) from arrays by path, with episodes concatenated. Raises UserError: no array of samples."""
    groups: dict[int, dict[str, np.ndarray]] = {}  # by episode, -1 for none
    for path, array in arrays.items():
        number, parts = -1, []
        for part in path.split("/"):
            match = EPISODE.fullmatch(part)
            if match and number < 0:
                number = int(match[2])
            else:
                parts.append(part)
        groups.setdefault(number, {})["/".join(parts)] = array
    if len(groups) > 1:
        groups.pop(-1, None)  # arrays outside the episodes
    blocks = {number: _columns(group) for number, group in sorted(groups.items())}
    blocks = {number: block for number, block in blocks.items() if block}
    if not blocks:
        raise UserError("holds no samples", file=file, expected="numeric arrays (n,) or (n, k) with n samples")
    names = [name for name in next(iter(blocks.values())) if all(name in block for block in blocks.values())]
    out = {name: np.concatenate([block[name] for block in blocks.values()]) for name in names}
    if len(blocks) > 1 and EPISODES not in out:
        sizes = [len(next(iter(block.values()))) for block in blocks.values()]
        out[EPISODES] = np.repeat(np.array([*blocks], float), sizes)
    return out


def _columns(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Make columns from the arrays that have the most common length, weighted by their count of numbers."""
    flat = {name: np.squeeze(a) if a.ndim > 2 or 1 in a.shape[1:] else a for name, a in arrays.items()}
    flat = {name: a[0] if a.ndim == 2 and a.shape[0] == 1 else a for name, a in flat.items()}
    flat = {name: a for name, a in flat.items() if a.ndim in (1, 2) and a.dtype.kind in "fiub" and a.size}
    votes: Counter[int] = Counter()
    for a in flat.values():
        votes[max(a.shape)] += 1 if a.ndim == 1 else min(a.shape)
    if not votes:
        return {}
    n = max(votes, key=lambda length: (votes[length], length))
    out: dict[str, np.ndarray] = {}
    for name, a in flat.items():
        a = a.T if a.ndim == 2 and a.shape[0] != n and a.shape[1] == n else a  # MATLAB: samples may be columns
        if a.shape[0] != n or (a.ndim == 2 and a.shape[1] > WIDEST):
            continue
        if a.ndim == 1:
            out[name] = a.astype(float)
        else:
            out |= {f"{name}[{k}]" if name else str(k + 1): a[:, k].astype(float) for k in range(a.shape[1])}
    return out


def _hdf5(file: Path) -> dict[str, np.ndarray]:
    try:
        import h5py
    except ImportError as error:
        raise missing("h5py", "an HDF5 file", file=str(file)) from error
    arrays: dict[str, np.ndarray] = {}
    with opened(file):  # raises UserError unless it is a regular file
        pass
    try:
        with h5py.File(file, "r") as store:

            def take(path: str, item: Any) -> None:
                small = isinstance(item, h5py.Dataset) and item.ndim in (1, 2) and item.dtype.kind in "fiub"
                if small and item.size * 8 <= MAX_BYTES and (item.ndim == 1 or min(item.shape) <= WIDEST):
                    arrays[path] = item[()]

            store.visititems(take)
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise UserError(f"is not an HDF5 file that can be read: {str(error).splitlines()[0]}", file=file) from error
    return arrays


def _mat(file: Path) -> dict[str, np.ndarray]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    with opened(file) as stream:
        newer = stream.read(512)[:10] == b"MATLAB 7.3"
    if newer:  # is HDF5
        return _hdf5(file)
    try:
        data = loadmat(str(file), simplify_cells=True)
    except (MatReadError, OSError, ValueError, TypeError, NotImplementedError, MemoryError) as error:
        raise UserError(f"is not a MATLAB file that can be read: {error}", file=file) from error
    return _flat({key: value for key, value in data.items() if not key.startswith("__")})


def _npy(file: Path) -> dict[str, np.ndarray]:
    with opened(file) as stream:
        try:
            array = np.load(stream, allow_pickle=False)
        except (ValueError, OSError, EOFError, SyntaxError) as error:
            what = "holds Python objects" if "allow_pickle" in str(error) else "is not a NumPy array that can be read"
            raise UserError(what, file=file, expected="a plain numeric array") from error
    return {name: array[name] for name in array.dtype.names} if array.dtype.names else {"": array}


def _json(file: Path) -> dict[str, np.ndarray]:
    data = read_json(file, most=MOST_TEXT, finite=False)
    return _rows(data) if isinstance(data, list) else _flat(data)


def _jsonl(file: Path) -> dict[str, np.ndarray]:
    lines = read_text(file, MOST_TEXT).splitlines()
    rows = [parse_json(line, file, f"line {i}", finite=False) for i, line in enumerate(lines, 1) if line.strip()]
    return _rows(rows)


def _rows(rows: list[Any]) -> dict[str, np.ndarray]:
    """Make arrays from rows that are mappings; a key that a row lacks is a missing value."""
    flat = [_plain(row) for row in rows if isinstance(row, dict)]
    names = list(dict.fromkeys(name for row in flat for name in row))
    out = {}
    for name in names:
        values = [row.get(name) for row in flat]
        width = max((len(v) for v in values if isinstance(v, list)), default=0)
        empty = [np.nan] * width if width else np.nan
        array = _numbers([empty if v is None else v for v in values])
        if array is not None:
            out[name] = array
    return out


def _plain(data: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Flatten nested mappings to path -> value."""
    out: dict[str, Any] = {}
    for key, value in data.items():
        out |= _plain(value, f"{above}{key}/") if isinstance(value, dict) else {f"{above}{key}": value}
    return out


def _flat(data: Any) -> dict[str, np.ndarray]:
    """Collect numeric arrays of nested mappings by path; a list of mappings is a list of rows."""
    out: dict[str, np.ndarray] = {}
    for path, value in _plain(data if isinstance(data, dict) else {}).items():
        if isinstance(value, list) and value and all(isinstance(row, dict) for row in value):
            out |= {f"{path}/{name}": array for name, array in _rows(value).items()}
        elif (array := _numbers(value)) is not None:
            out[path] = array
    return out


def _numbers(value: Any) -> np.ndarray | None:
    try:
        array = np.asarray(value)
        array = array.astype(float) if array.dtype == object else array
    except (ValueError, TypeError):
        return None
    return array if array.dtype.kind in "fiub" and array.ndim in (1, 2, 3) else None


READERS: dict[str, Callable[[Path], dict[str, np.ndarray]]] = {
    ".hdf5": _hdf5,
    ".h5": _hdf5,
    ".mat": _mat,
    ".npy": _npy,
    ".npz": lambda file: read_arrays(file, most=MAX_BYTES),
    ".json": _json,
    ".jsonl": _jsonl,
}
