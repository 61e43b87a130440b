"""Import a CSV or Parquet file with arbitrary column names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.recordings.columns import SIGNALS, columns_of
from vispeg.recordings.importers.build import build, joints_of, si
from vispeg.recordings.importers.clock import counted
from vispeg.recordings.importers.mapping import ColumnMap, Source
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Reading, Table


def import_table(
    source: Path,
    robot: str,
    joints: Sequence[str],
    mapping: ColumnMap | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Recording:
    """Import a recording from a table; see `ColumnMap.by_own_name` for columns that the map does not name.

    Args:
        source: a file or folder that `read_table` reads.
        robot: a name or a path.
        joints: the robot's joints.
        mapping: names and units of the columns.
        progress: called with the share that has been read, 0 to 1.

    Raises:
        UserError: a mapped column is absent or not numeric, or the recording would not pass `load`.
    """
    mapping = mapping or ColumnMap()
    targets = _targets(joints_of(joints, mapping), mapping)
    wanted = {*mapping.by_own_name(targets), *mapping.names}
    table = read_table(source, Reading(keep=lambda _: wanted, progress=progress, dialect=mapping.dialect))
    return from_table(table, source, robot, joints, mapping)


def from_table(table: Table, source: Path, robot: str, joints: Sequence[str], mapping: ColumnMap) -> Recording:
    """Build a recording from a table that has been read; see `import_table`."""
    targets = _targets(joints_of(joints, mapping), mapping)
    columns = {}
    for target, origin in mapping.columns.items():
        if target not in targets:  # a whole signal can only come from an array
            raise UserError("names no single column", file=mapping.file, key=target, choices=targets)
        if not origin.name:  # declared missing in the map
            columns[target] = np.full(table.rows, np.nan)
            continue
        columns[target] = summed(table, origin)
    columns |= {name: table.number(name) for name in mapping.by_own_name(targets) if name in table.names}
    if mapping.rate_hz is not None:
        columns["time"] = counted(columns.get("episode"), table.rows, mapping.rate_hz, source, table.names)
    if "time" not in columns:
        said = "has no column `time`; a map can say which it is, or --rate-hz how many samples a second there are"
        raise UserError(said, file=source, choices=table.names)
    if table.comments:
        count = len(table.comments)
        lines = (
            "1 line before the header is no sample" if count == 1 else f"{count} lines before the header are no samples"
        )
        note(f"{source}: {lines}: {table.comments[0][:80]}")
    return build(columns, source, robot, joints, mapping, table.numbers)


def summed(table: Table, origin: Source) -> np.ndarray:
    """Return a column (n,) in SI units: the source column plus the further columns in the map's `plus`."""
    if origin.name in table.dates and origin.factor != 1.0:
        raise UserError("holds dates or times of day", file=table.file, key=origin.name, expected="no unit, no scale")
    own = si(table.number(origin.name), origin)
    return sum((summed(table, term) for term in origin.plus), start=own)


def _targets(names: list[str], mapping: ColumnMap) -> list[str]:
    return ["time", "episode", *(c for s in (*SIGNALS, *mapping.own) for c in columns_of(s, names))]
