"""Read a table of samples in any supported format: one file, or a folder of files that belong together."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.guard import refuse_special
from vispeg.recordings.differentiate import episodes
from vispeg.recordings.resample import linear
from vispeg.recordings.tables.stores import EPISODES, READERS, read_store
from vispeg.recordings.tables.table import MAX_BYTES, Reading, Table, check_rows
from vispeg.recordings.tables.table_csv import read_csv
from vispeg.recordings.tables.table_parquet import read_parquet

EVERYTHING = Reading()
TEXTS = (".csv", ".csv.gz", ".tsv", ".txt", ".dat")
TABLES = (*TEXTS, ".parquet")
STORES = tuple(READERS)
LEROBOT = Path("meta") / "info.json"
# columns of commands, each of which holds until the next; file names that name a signal; columns of time
HELD = re.compile(r"cmd|command|goal|target|desired|setpoint|(^|[^a-z])ref|action", re.IGNORECASE)
SIGNAL = re.compile(r"pos|angle|vel|speed|effort|torq|tau|curr|cmd|command|goal|target", re.IGNORECASE)
CLOCKS = re.compile(r"(^|[^a-z])(t|time|timestamp|stamp|zeit)([^a-z]|$)", re.IGNORECASE)


def is_text(file: Path) -> bool:
    """Return whether a table is written as text, by the end of its file's name."""
    return file.name.lower().endswith(TEXTS)


def parts(source: Path) -> list[Path]:
    """List the files of a table that is a folder, in order: a LeRobot data set's, or all tables in it; else empty."""
    if not source.is_dir():
        return []
    if (source / LEROBOT).is_file():
        return sorted((source / "data").rglob("*.parquet"))
    files = [path for path in source.iterdir() if path.name.lower().endswith((*TABLES, *STORES)) and path.is_file()]
    data = [path for path in files if path.suffix.lower() != ".json"] or files  # JSON files beside tables are settings
    return sorted(data, key=lambda path: [int(t) if t.isdigit() else t for t in re.split(r"(\d+)", path.name)])


def read_table(file: Path, reading: Reading = EVERYTHING) -> Table:
    """Read a table.

    Args:
        file: a text table, Parquet, a file of arrays (`stores`), or a folder. A folder's files with the same columns
            are episodes (a LeRobot data set numbers its own); others are signals of one run (`position.csv`,
            `effort.csv`), joined on their times.
        reading: what is kept.

    Raises:
        UserError: no table of samples; files of a folder that do not fit together.
    """
    import pyarrow

    refuse_special(file)
    files = parts(file)
    try:
        table = _folder(file, files, reading) if files else _file(file, reading)
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror or error}", file=file) from error
    pyarrow.default_memory_pool().release_unused()  # the pool keeps half as much memory as the columns for reuse
    if table.rows == 0:
        raise UserError("holds no samples", file=file)
    return table


def _file(file: Path, reading: Reading) -> Table:
    kind = file.suffix.lower()
    if kind in READERS:
        return read_store(file, reading)
    size = file.stat().st_size
    if size > MAX_BYTES:
        raise UserError("is too large", file=file, expected=f"at most {MAX_BYTES} bytes; split it", got=size)
    return (read_parquet if kind == ".parquet" else read_csv)(file, reading)


def _folder(folder: Path, files: Sequence[Path], reading: Reading) -> Table:
    whole = replace(reading, keep=None, look=None)
    if len(files) == 1:
        return replace(_file(files[0], reading), file=folder)
    tables = [_file(file, whole) for file in files]
    check_rows(sum(table.rows for table in tables), folder)
    matches = [SIGNAL.search(table.file.stem) for table in tables]
    by_signal = all(matches) and len({match[0].lower() for match in matches if match}) > 1  # one file per signal
    same_columns = not by_signal and all(table.names == tables[0].names for table in tables)
    columns = _episodes(tables) if same_columns else _joined(folder, tables)
    text, mixed = _texts(tables, same_columns)
    names = list(columns)
    rows = len(next(iter(columns.values()), ()))
    kept = {name: columns[name] for name in reading.retained(names) if name in columns}
    dates = frozenset(name if same_columns else _key(table, name) for table in tables for name in table.dates)
    return Table(folder, kept, [*names, *text], rows, range(rows), text, mixed=mixed, dates=dates)


def _texts(tables: Sequence[Table], same_columns: bool) -> tuple[dict[str, tuple[int, str]], frozenset[str]]:
    """Return `text` and `mixed` of a folder's tables together; mixed cells are stated with their file."""
    text: dict[str, tuple[int, str]] = {}
    numbers: set[str] = set()
    for table in tables:
        numbers |= {name if same_columns else _key(table, name) for name in (*table.mixed, *table.columns)}
    for table in tables:
        for name, (row, cell) in table.text.items():
            key = name if same_columns else _key(table, name)
            text.setdefault(key, (row, f"{cell} ({table.file.name})" if key in numbers else cell))
    return text, frozenset(numbers & {*text})


def _key(table: Table, name: str) -> str:
    """Name a column of one of several joined tables."""
    return f"{table.file.stem.split('.')[0]}/{name}"


def _episodes(tables: Sequence[Table]) -> dict[str, np.ndarray]:
    """Concatenate tables with the same columns, and number the episodes unless the tables have a number themselves."""
    names = [name for name in tables[0].names if all(name in table.columns for table in tables)]
    out = {name: np.concatenate([table.columns[name] for table in tables]) for name in names}
    if not any(EPISODES in re.findall(r"[a-z]+", name.lower()) for name in names):
        out[EPISODES] = np.repeat(np.arange(len(tables), dtype=float), [table.rows for table in tables])
    return out


def _joined(folder: Path, tables: Sequence[Table]) -> dict[str, np.ndarray]:
    """Join the tables of one run on the times of the first one named position or angle, else of the longest.

    Measured values are interpolated linearly, except across gaps; commands are held until the next. Where the clock of
    that table steps back, the next run begins in every table. Column names get the file's name as a prefix.

    Raises:
        UserError: a table without samples or without a time, times that do not overlap, or different numbers of runs.
    """
    clocks = []
    for table in tables:
        if not table.rows:
            raise UserError("holds no samples", file=table.file)
        named = [name for name in table.names if CLOCKS.search(name) and name in table.columns]
        if not named:
            raise UserError("has no column for the time", file=table.file, expected="one in every file that is joined")
        clocks.append(min(named, key=len))
    first = next((i for i, t in enumerate(tables) if re.search("pos|angle|state|_q|q_", t.file.stem.lower())), None)
    first = max(range(len(tables)), key=lambda i: tables[i].rows) if first is None else first
    time = tables[first].columns[clocks[first]]
    runs = episodes(time)
    out = {clocks[first]: time}
    for table, clock in zip(tables, clocks, strict=True):
        at = table.columns[clock]
        own = episodes(at) if len(runs) > 1 else [np.arange(len(at))]
        if len(own) != len(runs):
            expected = f"{len(runs)}, as in {tables[first].file.name}"
            raise UserError("has another number of runs", file=table.file, key=clock, expected=expected, got=len(own))
        names = [name for name in table.columns if name != clock]
        parts = [_onto(time[run], at[rows], table, names, rows) for run, rows in zip(runs, own, strict=True)]
        out |= {_key(table, name): np.concatenate([part[name] for part in parts]) for name in names}
    return out


def _onto(
    time: np.ndarray, at: np.ndarray, table: Table, names: Sequence[str], rows: np.ndarray
) -> dict[str, np.ndarray]:
    """Bring the `rows` of a table's columns, whose times are `at` (m,), onto the times (n,) of one run.

    Raises:
        UserError: the times do not overlap.
    """
    if at[0] > time[-1] or at[-1] < time[0]:
        raise UserError("does not overlap the other files in time", file=table.file)
    at, once = np.unique(at, return_index=True)
    last = np.searchsorted(at, time, side="right") - 1
    out: dict[str, np.ndarray] = {}
    for name in names:
        values = table.columns[name][rows][once]
        if HELD.search(_key(table, name)):
            out[name] = np.where(last >= 0, values[np.maximum(last, 0)], np.nan)
        else:
            out[name] = linear(time, at, values[:, None])[:, 0]
    return out
