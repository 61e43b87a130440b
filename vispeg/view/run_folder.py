"""Read a training run from disk, without torch: its progress table, checkpoints and films."""

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
FILM_BYTES = 8 * MB  # largest film that the page embeds


@dataclass(frozen=True)
class Run:
    """Files that a run has written so far.

    Attributes:
        folder: the run's folder.
        curves: column of the progress table -> (n,) values, NaN for empty cells.
        failures: text of the last row's column `failures`.
        checkpoints: names, the best first, the others from newest to oldest.
        films: video files.
    """

    folder: Path
    curves: Mapping[str, np.ndarray]
    failures: str
    checkpoints: tuple[str, ...]
    films: tuple[Path, ...]


def is_run(path: Path) -> bool:
    """Return whether a folder is that of a training run."""
    return any((path / name).is_file() for name in (TABLE, BEGUN))


def runs_in(path: Path) -> list[Path]:
    """Return the runs in a folder: itself, or those one or two levels below, the most recently written first.

    A run that is being replaced, `.NAME.XXXXXXXX.old`, is not one of them.
    """
    if is_run(path):
        return [path]
    runs = [p for pattern in ("[!.]*", "[!.]*/[!.]*") for p in path.glob(pattern) if p.is_dir() and is_run(p)]
    return sorted(runs, key=lambda p: -max(f.stat().st_mtime for f in p.iterdir()))


def newest(path: Path) -> Path | None:
    """Return the most recently written run in a folder; None without any."""
    return next(iter(runs_in(path)), None)


def read(folder: Path) -> Run:
    """Read what a run has written so far.

    Raises:
        UserError: not the folder of a run, or an unreadable table.
    """
    if not is_run(folder):
        raise UserError("is not the folder of a training run", file=folder, expected=f"{TABLE} or {BEGUN} in it")
    rows: list[dict[str, str]] = []
    if (folder / TABLE).is_file():
        rows = list(csv.DictReader(io.StringIO(read_text(folder / TABLE, 64 * MB), newline="")))
    names = [name for name in (rows[0] if rows else ()) if name]
    curves = {name: np.array([_number(row.get(name)) for row in rows]) for name in names}
    inside = [p for p in (folder / CHECKPOINTS).glob("*") if (p / "policy.json").is_file()]
    order = sorted(inside, key=lambda p: (p.name != "best", -p.stat().st_mtime))
    films = sorted((folder / FILMS).glob("*.mp4"))
    failures = str(rows[-1].get("failures") or "") if rows else ""
    return Run(folder, curves, failures, tuple(p.name for p in order), tuple(films))


def film(path: Path) -> bytes:
    """Return a film's bytes. Raises UserError: too large to show."""
    if path.stat().st_size > FILM_BYTES:
        raise UserError("is too large to show here", file=path, expected=f"{FILM_BYTES / MB:.0f} MB at most")
    return path.read_bytes()


def _number(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")
