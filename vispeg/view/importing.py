"""A log becomes a recording, in a worker process: a proposal, a look at what it means, the folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vispeg.api.recording.convert import placed
from vispeg.api.recording.guess import propose
from vispeg.core.errors import UserError
from vispeg.core.files import refuse, write_text_atomic
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.columns import SIGNALS
from vispeg.recordings.importers.guess.words import advice, data
from vispeg.recordings.importers.mapping import FACTORS, ColumnMap, map_from, read_map
from vispeg.recordings.importers.plausible import doubts
from vispeg.recordings.importers.source import is_table, read_source
from vispeg.recordings.recording import Recording
from vispeg.recordings.write import write
from vispeg.robots.model import load
from vispeg.sim.units import needs_of

MOST = 2000  # samples of the look


@dataclass(frozen=True)
class Proposed:
    """A map to be confirmed.

    Attributes:
        lines: (target, column, unit, reason) of each column; none for a file that names its signals itself.
        units: signal -> its unit, of those whose unit can be chosen.
        data: the map as plain data, as a map file holds it.
        remarks: what a person should look at, and what would buy more.
    """

    lines: tuple[tuple[str, str, str, str], ...]
    units: Mapping[str, str]
    data: Mapping[str, Any]
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class Look:
    """What a map makes of a log: time (n,) s, signals (n, nj) in SI units, and what cannot be true of them."""

    time: np.ndarray
    joints: tuple[str, ...]
    signals: Mapping[str, np.ndarray]
    rate_hz: float
    samples: int
    doubts: tuple[str, ...]


class Importer:
    """What the page's worker holds; `tell` is called with "proposed" (Proposed) and "look" (Look)."""

    def __init__(self, tell: Callable[[str, Any], None]):
        self.tell = tell

    def propose(self, source: Path, robot: str) -> None:
        """Proposes a map, and looks at what it makes of the log.

        Raises:
            UserError: no such file or robot, or no column that can be the time or the angles.
        """
        if not source.exists():
            raise UserError("does not exist", file=source)
        self.tell("say", f"reading {source.name}")
        proposed = Proposed((), {}, {}, ())
        if is_table(source):
            proposal = propose(source, robot).proposal
            lines = tuple((line.target, line.column, line.unit or "", line.why) for line in proposal.lines)
            units = {target.partition(".")[0]: unit for target, _, unit, _ in lines if unit in FACTORS}
            remarks = (*proposal.doubts, *advice(proposal))
            proposed = Proposed(lines, units, data(proposal), remarks)
        self.tell("proposed", proposed)
        self.look(source, robot, dict(proposed.data))

    def look(self, source: Path, robot: str, columns: dict[str, object]) -> None:
        """Reads the log with a map and tells what comes out."""
        model = load(robot)
        rec = _read(source, robot, map_from(columns, source, model.joints))
        every = slice(None, None, max(1, -(-len(rec.time) // MOST)))
        there = {name: getattr(rec, name)[every] for name in SIGNALS if getattr(rec, name) is not None}
        signals = {name: value for name, value in there.items() if value.ndim == 2}
        degrees = str(columns.get(f"q.{rec.joints[0]}", {})).find("deg") >= 0
        said = doubts(rec, Limits.of(model, rec.joints), degrees, needs_of(model, rec))
        lines = tuple(f"{d.key}: {d.said}" + (f" (likely {d.likely})" if d.likely else "") for d in said)
        self.tell("look", Look(rec.time[every], tuple(rec.joints), signals, rec.rate_hz, len(rec.time), lines))

    def write(self, source: Path, robot: str, columns: dict[str, object], out: Path) -> str:
        """Writes the map beside the folder, and the folder as `vispeg convert --map` would; returns its path."""
        model = load(robot)
        refuse(out, False)
        file = out.with_name(f"{out.name}-map.yaml") if columns else None
        if file is not None:
            write_text_atomic(file, yaml.safe_dump(columns, sort_keys=False, allow_unicode=True), overwrite=True)
        rec = _read(source, robot, read_map(file, model.joints))
        write(rec, out, False, "parquet", inputs=(source,))
        return str(out)


def _read(source: Path, robot: str, mapping: ColumnMap) -> Recording:
    return read_source(source, placed(robot), load(robot).joints, mapping)
