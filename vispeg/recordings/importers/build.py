"""The last step of every importer: named columns become a recording that has passed all checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.importers.clock import cleaned
from vispeg.recordings.importers.mapping import ColumnMap, Source
from vispeg.recordings.importers.motors import joint_side
from vispeg.recordings.load import assemble
from vispeg.recordings.recording import Recording
from vispeg.recordings.schema import FORMAT, header_from
from vispeg.recordings.tables.table import Table

EPOCH = 1e6  # s: times beyond are dates; seconds from the first sample keep more digits


def joints_of(joints: Sequence[str], mapping: ColumnMap) -> list[str]:
    """Give the joints to import: the map's own list where it has one, else the robot's."""
    stated = mapping.recording.get("joints", list(joints))
    return [str(name) for name in stated] if isinstance(stated, list) else list(joints)


def si(values: np.ndarray, source: Source) -> np.ndarray:
    """Raw values in SI units."""
    return values if source.factor == 1.0 and source.offset == 0.0 else values * source.factor + source.offset


def build(
    columns: Mapping[str, np.ndarray],
    source: Path,
    robot: str,
    joints: Sequence[str],
    mapping: ColumnMap,
    first_row: int = 0,
    **header: Any,
) -> Recording:
    """Give a recording from columns (n,) in SI units, named as in samples.csv.

    Args:
        columns: `time`, `q.joint1`, ...
        source: the file they come from, which messages name.
        robot: a name or a path.
        joints: the robot's joints.
        mapping: its `recording` keys go into the header.
        first_row: what the source calls its first sample.
        header: further keys; the mapping's win.
    """
    time = columns.get("time")
    if time is None:
        raise UserError("has no time", file=source, expected="a column `time`, or a map that says which it is")
    columns = joint_side(cleaned(dict(columns), source, first_row), joints_of(joints, mapping), mapping, source)
    time = columns["time"]
    start = time[0] if len(time) else 0.0
    if np.isfinite(start) and abs(start) > EPOCH:
        columns["time"] = time - start
    steps = np.diff(time)
    steps = steps[steps > 0]
    rate = 1.0 / float(np.median(steps)) if len(steps) else 1.0
    data = {"format": FORMAT, "robot": robot, "joints": joints_of(joints, mapping), "rate_hz": _rounded(rate)}
    data |= {"notes": f"imported from {source.name}"} | header | dict(mapping.recording)
    table = Table(source, columns, list(columns), len(columns["time"]), first_row)
    if table.rows == 0:
        raise UserError("holds no samples", file=source)
    return assemble(header_from(data, mapping.file or source), table, Path(source.stem), mapping.file or source)


def _rounded(rate: float) -> float:
    """Take a rate within 1 % of a whole number for that number: clocks jitter, controllers do not run at 499.98 Hz."""
    nearest = round(rate)
    return float(nearest) if nearest and abs(rate / nearest - 1) < 0.01 else rate
