"""Imports a CSV or Parquet file with columns of any name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.recordings.columns import SIGNALS, columns_of
from vispeg.recordings.importers.build import build, convert, joints_of
from vispeg.recordings.importers.mapping import ColumnMap
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Reading


def import_table(
    source: Path,
    robot: str,
    joints: Sequence[str],
    mapping: ColumnMap | None = None,
    progress: Callable[[float], None] = lambda share: None,
    **header: Any,
) -> Recording:
    """A recording from a table; columns that the map does not name are taken by the recording format's own names.

    Args:
        source: a .csv, .csv.gz or .parquet file.
        robot: a name or a path.
        joints: the robot's joints.
        mapping: names and units of the columns.
        progress: called with how much has been read, 0 to 1.
        header: further keys of recording.yaml.

    Raises:
        UserError: a mapped column is absent or not numeric, or the recording would not pass `load`.
    """
    mapping = mapping or ColumnMap()
    names = joints_of(joints, mapping)
    targets = ["time", "episode", *(c for s in SIGNALS for c in columns_of(s, names))]
    wanted = {*targets, *(origin.name for origin in mapping.columns.values())}
    table = read_table(source, Reading(keep=lambda _: wanted, progress=progress, dialect=mapping.dialect))
    columns = {}
    for target, origin in mapping.columns.items():
        if target not in targets:  # a whole signal can only come from an array
            raise UserError("names no single column", file=mapping.file, key=target, choices=targets)
        columns[target] = convert(table.number(origin.name), origin)
    for target in targets:
        if target not in columns and target in table.names:
            columns[target] = table.number(target)
    if "time" not in columns:
        raise UserError("has no column `time`; a map can say which it is", file=source, choices=table.names)
    return build(columns, source, robot, joints, mapping, table.first_row, **header)
