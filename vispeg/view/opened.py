"""What a person asks to see: a folder or file of any kind that the package knows, told apart by its content."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vispeg.core.errors import UserError

TABLES = (".csv", ".gz", ".parquet", ".npz", ".mcap", ".bag", ".db3")


@dataclass(frozen=True)
class Opened:
    """What the pages start with; all of it may be empty.

    Attributes:
        recordings: folders.
        model: as `vispeg diagnose` takes it.
        logs: files that are no recordings yet.
    """

    recordings: tuple[Path, ...] = ()
    model: str = "iiwa14"
    logs: tuple[Path, ...] = ()


def opened(sources: Sequence[str]) -> Opened:
    """Tells apart what was named.

    Raises:
        UserError: something that is not there, or nothing that can be shown.
    """
    recordings: list[Path] = []
    logs: list[Path] = []
    model = "iiwa14"
    for text in sources:
        path = Path(text)
        if not path.exists():
            raise UserError("is not there", file=text, expected="a recording, a folder of some, a log, or a model")
        if (path / "recording.yaml").is_file():
            recordings.append(path)
        elif path.is_dir() and (inside := _recordings(path)):
            recordings += inside
        elif path.is_dir() and (path / "model.yaml").is_file():
            model = str(path / "model.yaml")
        elif path.suffix.lower() in (".yaml", ".yml", ".xml", ".urdf", ".mjcf"):
            model = str(path)
        elif path.suffix.lower() in TABLES or path.is_dir() and (path / "metadata.yaml").is_file():
            logs.append(path)
        else:
            raise UserError("is nothing that can be shown", file=text, expected="a recording, a log, or a model")
    return Opened(tuple(dict.fromkeys(recordings)), model, tuple(logs))


def _recordings(folder: Path) -> list[Path]:
    return sorted(child for child in folder.iterdir() if (child / "recording.yaml").is_file())
