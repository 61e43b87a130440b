"""Find what can be opened: in the working folder and in the package."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from vispeg.core.assets import assets
from vispeg.core.errors import UserError
from vispeg.datasets.opening import holds_dataset
from vispeg.formats.guard import is_file, opened
from vispeg.trials.live import is_live
from vispeg.trials.trial import FILE
from vispeg.view.run_folder import is_run

Kind = Literal["recording", "log", "model", "world", "policy", "dataset", "run", "trials"]
TABLES = (".csv", ".gz", ".tsv", ".parquet", ".npz", ".hdf5", ".h5", ".mat", ".mcap", ".bag", ".db3")
HEADS: dict[str, tuple[tuple[bytes, Kind], ...]] = {  # file ending -> words in the first lines that identify the kind
    ".urdf": ((b"<robot", "model"),),
    ".xml": ((b"<mujoco", "model"),),
    ".mjcf": ((b"<mujoco", "model"),),
    ".yaml": ((b"vispeg-model/", "model"), (b"vispeg-world/", "world")),
    ".yml": ((b"vispeg-model/", "model"), (b"vispeg-world/", "world")),
}
HEAD = 4096  # number of bytes searched for these words
DEEPEST = 4  # levels below the working folder; this program writes two or three levels deep
MOST = 4000  # most folders and files to inspect, about a second on a slow disk
PASSED_OVER = {"node_modules", "site-packages", "__pycache__", "venv", "env", "build", "dist"}


@dataclass
class Around:
    """Paths by kind, sorted by name.

    Attributes:
        places: kind -> paths.
        more: whether the search stopped at `MOST`.
    """

    places: dict[Kind, list[Path]] = field(default_factory=dict)
    more: bool = False

    def of(self, kind: Kind) -> list[Path]:
        """Return the paths of a kind."""
        return self.places.get(kind, [])


def kind_of(path: Path) -> Kind | None:
    """Return the kind of a file or folder by its content; None for a folder that merely contains such items."""
    if path.is_dir():
        return _kind_of_folder(path)
    if not is_file(path):
        return None
    ending = path.suffix.lower()
    if ending not in HEADS:
        return "log" if ending in TABLES else None
    try:
        with opened(path) as file:
            head = file.read(HEAD)
    except UserError:
        return None
    return next((kind for word, kind in HEADS[ending] if word in head), None)


def _kind_of_folder(path: Path) -> Kind | None:
    if is_file(path / "policy.json"):
        return "policy"
    if is_file(path / "recording.yaml"):
        return "recording"
    if is_file(path / "metadata.yaml"):
        return "log"  # a ROS 2 bag
    try:
        if holds_dataset(path):
            return "dataset"
        if is_live(path) or next(path.glob(f"*/{FILE}"), None) is not None:
            return "trials"
        return "run" if is_run(path) else None
    except OSError:
        return None


def around(folder: Path) -> Around:
    """Find everything of a known kind in a folder; skip hidden folders and those of other programs."""
    out, remaining, level = Around(), MOST, [folder]
    for _ in range(DEEPEST + 1):
        below: list[Path] = []
        for path in level:
            for child in _children(path):
                remaining -= 1
                if remaining < 0:
                    out.more = True
                    return out
                kind = kind_of(child)
                if kind is not None:
                    out.places.setdefault(kind, []).append(child)
                elif child.is_dir() and not child.is_symlink():
                    below.append(child)
                if kind in ("run", "trials"):  # a run's checkpoints are policies, and each trial is a recording
                    below.append(child)
        level = below
    return out


def _children(folder: Path) -> Iterator[Path]:
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        return
    for name in names:
        if not name.startswith((".", "_")) and name not in PASSED_OVER:
            yield folder / name


def shipped_recordings() -> list[Path]:
    """Return the bundled example recordings, of an arm with two hidden effects."""
    return sorted(p for p in (assets() / "recordings").iterdir() if (p / "recording.yaml").is_file())


def named(paths: Iterable[Path], folder: Path) -> dict[str, Path]:
    """Return the paths by display name: relative to a folder if inside it."""
    out = {}
    for path in paths:
        inside = path.is_relative_to(folder)
        out[str(path.relative_to(folder) if inside else path)] = path
    return out
