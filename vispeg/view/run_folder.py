"""A training run as it lies on disk: the rows that it has written, its checkpoints and its films. Without torch."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.guard import MB, read_text

TABLE, BEGUN, CHECKPOINTS, FILMS = "progress.csv", "begun.json", "checkpoints", "films"
FILM_BYTES = 8 * MB


@dataclass(frozen=True)
class Run:
    """What a run has written so far.

    Attributes:
        folder: of it.
        curves: column -> (n,) values, NaN where a row has none.
        failures: of the last row, in words.
        checkpoints: names, the best first, then the newest.
        films: files.
    """

    folder: Path
    curves: Mapping[str, np.ndarray]
    failures: str
    checkpoints: tuple[str, ...]
    films: tuple[Path, ...]


def is_run(path: Path) -> bool:
    """Whether a folder is a training run's."""
    return any((path / name).is_file() for name in (TABLE, BEGUN))


def runs_in(path: Path) -> list[Path]:
    """Give the runs in a folder: itself, or those one or two levels below it, the one that wrote last first."""
    if is_run(path):
        return [path]
    runs = [p for pattern in ("*", "*/*") for p in path.glob(pattern) if p.is_dir() and is_run(p)]
    return sorted(runs, key=lambda p: -max(f.stat().st_mtime for f in p.iterdir()))


def newest(path: Path) -> Path | None:
    """Give the run in a folder that wrote last; None without any."""
    return next(iter(runs_in(path)), None)


def read(folder: Path) -> Run:
    """Give what a run has written.

    Raises:
        UserError: no run's folder, or a table that is none.
    """
    if not is_run(folder):
        raise UserError("no training run", file=folder, expected=f"{TABLE} or {BEGUN}, as `vispeg train` writes")
    rows: list[dict[str, str]] = []
    if (folder / TABLE).is_file():
        rows = list(csv.DictReader(io.StringIO(read_text(folder / TABLE, 64 * MB), newline="")))
    names = [name for name in (rows[0] if rows else ()) if name]
    curves = {name: np.array([_number(row.get(name)) for row in rows]) for name in names}
    inside = [p for p in (folder / CHECKPOINTS).glob("*") if (p / "policy.json").is_file()]
    order = sorted(inside, key=lambda p: (p.name != "best", -p.stat().st_mtime))
    films = sorted((folder / FILMS).glob("*.mp4"))
    said = str(rows[-1].get("failures") or "") if rows else ""
    return Run(folder, curves, said, tuple(p.name for p in order), tuple(films))


def film(path: Path) -> bytes:
    """Give a film's bytes. Raises UserError: too large to be shown."""
    if path.stat().st_size > FILM_BYTES:
        raise UserError("is too large to be shown here", file=path, expected=f"{FILM_BYTES / MB:.0f} MB at most")
    return path.read_bytes()


def _number(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")
