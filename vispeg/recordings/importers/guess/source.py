"""Reads as much of a table as a guess needs, and what lies beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.formats.json_data import read_json
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.guess.dialect import dialect_of
from vispeg.recordings.importers.guess.propose import Proposal, propose
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Dialect, Reading

ROWS = 200_000  # that are looked at: header and ranges need no more
INFO = "meta/info.json"  # of a LeRobot data set, up to four folders above its tables


def guess(source: Path, joints: Sequence[str], limits: Limits) -> Proposal:
    """A map for a table of unknown names; nothing is taken from a name that the numbers contradict.

    Args:
        source: a .csv, .csv.gz or .parquet file.
        joints: the robot's joints.
        limits: of these joints.

    Raises:
        UserError: no table, or one in which no column can be the time or the angles.
    """
    dialect = Dialect() if source.suffix.lower() == ".parquet" else dialect_of(source)
    table = read_table(source, Reading(most_rows=ROWS, dialect=dialect))
    return propose(table, joints, limits, dialect, _lerobot(source))


def _lerobot(source: Path) -> dict[str, str]:
    """Columns `observation.state[0]` -> the joint that a LeRobot data set's information names for it."""
    for folder in source.resolve().parents[:4]:
        if (folder / INFO).is_file():
            try:
                features = read_json(folder / INFO)["features"]
                return {label: name for key in features for label, name in _named(key, features[key])}
            except (UserError, KeyError, TypeError, AttributeError):
                return {}  # of another program, or damaged: the header has to do
    return {}


def _named(key: str, feature: Any) -> list[tuple[str, str]]:
    names = feature.get("names")
    if isinstance(names, dict):
        names = next((value for value in names.values() if isinstance(value, list)), None)
    if feature.get("dtype") not in ("float32", "float64") or not isinstance(names, list):
        return []
    return [(f"{key}[{i}]", str(name).removesuffix(".pos")) for i, name in enumerate(names)]
