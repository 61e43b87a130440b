"""Read a dataset's list of episodes: the frames of each, the values drawn for it, and its outcome."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NotRequired, TypedDict, cast

from vispeg.core.errors import UserError
from vispeg.core.seeds import LAST_SEED
from vispeg.datasets.describe import is_integer, is_number
from vispeg.datasets.parquet import checked, opened, read, table
from vispeg.formats.guard import read_bytes
from vispeg.formats.json_data import parse_json

FOLDER, LINES = "meta/episodes", "meta/episodes.jsonl"
LARGEST = 1_000_000_000  # most bytes of `LINES`
OWN = "vispeg/"  # prefix of columns that LeRobot does not have
# columns that state where an episode lies
PLACES = ("episode_index", "length", "dataset_from_index", "dataset_to_index", "data/chunk_index", "data/file_index")


@contextmanager
def of_episode(number: int) -> Iterator[None]:
    """Name the episode that is read, before all else, in a UserError of the body."""
    try:
        yield
    except UserError as error:
        raise UserError(str(error), key=f"episode {number}") from error


def _is_world(value: Any) -> bool:
    """Return whether a value is a drawn world: a mapping effect -> parameter -> number."""
    if not isinstance(value, dict):
        return False
    return all(isinstance(params, dict) and all(map(is_number, params.values())) for params in value.values())


def _is_seed(value: Any) -> bool:
    return is_integer(value) and 0 <= value <= LAST_SEED


KINDS: Mapping[str, Callable[[Any], bool]] = {  # column without its prefix -> test of its values
    "seed": _is_seed,
    "look": is_integer,
    "look_seed": _is_seed,
    "redraws": lambda n: is_integer(n) and 0 <= n < 10**6,
    "redraws_exhausted": lambda b: isinstance(b, bool),
    "cut": lambda b: isinstance(b, bool),
    "success": lambda b: isinstance(b, bool),
    "category": lambda s: isinstance(s, str),
    "peak_force": lambda f: is_number(f) and f >= 0,
    "world": _is_world,
    "cameras": lambda records: isinstance(records, list) and all(isinstance(r, dict) for r in records),
}


class Stretch(TypedDict):
    """The position of an episode among the frames of its dataset; other keys may be present."""

    length: int
    dataset_from_index: int


EpisodeRow = TypedDict(
    "EpisodeRow",
    {
        "length": int,
        "dataset_from_index": int,
        "dataset_to_index": int,
        "episode_index": int,
        "data/chunk_index": int,
        "data/file_index": int,
        "vispeg/seed": NotRequired[int | None],
        "vispeg/look": NotRequired[int | None],
        "vispeg/look_seed": NotRequired[int | None],
        "vispeg/redraws": NotRequired[int | None],
        "vispeg/redraws_exhausted": NotRequired[bool | None],
        "vispeg/cut": NotRequired[bool | None],
        "vispeg/success": NotRequired[bool | None],
        "vispeg/category": NotRequired[str | None],
        "vispeg/peak_force": NotRequired[float | None],
        "vispeg/world": NotRequired[Mapping[str, Mapping[str, float]] | None],
        "vispeg/cameras": NotRequired[list[Mapping[str, object]] | None],
    },
)


def read_episodes(folder: Path, total: int) -> list[EpisodeRow]:
    """Read one mapping per episode, without statistics; JSON values such as drawn worlds are decoded.

    Args:
        folder: folder of the dataset.
        total: total number of frames that the episodes must have.

    Raises:
        UserError: no episodes, damaged files, entries of a wrong type, or episodes that do not follow one another.
    """
    files = sorted((folder / FOLDER).glob("*/*.parquet"))
    if not files:
        raise UserError("has no episodes", file=folder / FOLDER)
    rows: list[EpisodeRow] = []
    for path in files:
        file = opened(path)
        names = [name for name in file.schema_arrow.names if not name.startswith("stats/")]
        batch = read(table(file, path, names).to_pylist, path)
        for i, row in enumerate(batch):
            for key in PLACES:
                if not is_integer(row.get(key)) or not 0 <= row[key] <= 10**12:
                    raise UserError("not a count", file=path, key=f"row {i}, {key}", got=row.get(key))
            for key, value in row.items():
                if key.startswith(OWN) and isinstance(value, str) and value[:1] in "{[":
                    row[key] = parse_json(value, path, f"row {i}, {key}")
        checked(batch, {OWN + key: kind for key, kind in KINDS.items()}, path)
        rows += [cast("EpisodeRow", row) for row in batch]
    rows.sort(key=lambda row: row["episode_index"])
    _follow(rows, folder, total)
    return rows


def read_episodes_before(folder: Path, total: int, chunk: int) -> list[EpisodeRow]:
    """Read the episodes of a LeRobot version 2 dataset, which has a line in `meta/episodes.jsonl` and a file for each.

    Args:
        folder, total: as in `read_episodes`.
        chunk: number of episodes in a folder.

    Raises:
        UserError: no such file, or lines that are not the episodes in order.
    """
    path, rows, at = folder / LINES, list[EpisodeRow](), 0
    for i, text in enumerate(read_bytes(path, LARGEST).splitlines()):
        line = parse_json(text, path, f"line {i + 1}")
        length: Any = line.get("length") if isinstance(line, dict) else None
        if not is_integer(length) or line.get("episode_index") != i:
            raise UserError("not the next episode", file=path, key=f"line {i + 1}")
        rows.append(
            {
                "length": length,
                "dataset_from_index": at,
                "dataset_to_index": at + length,
                "episode_index": i,
                "data/chunk_index": i // chunk,
                "data/file_index": i,
            }
        )
        at += length
    _follow(rows, folder, total)
    return rows


def _follow(rows: Sequence[EpisodeRow], folder: Path, total: int) -> None:
    """Raise UserError unless episodes follow one another without a gap and have `total` frames."""
    at, path = 0, folder / FOLDER
    for i, e in enumerate(rows):
        if e["episode_index"] != i:
            raise UserError(f"line {i} is of episode {e['episode_index']}", file=path)
        lies = e["dataset_from_index"], e["dataset_to_index"]
        if e["length"] < 1 or lies != (at, at + e["length"]):
            expected = f"{at} to {at + max(e['length'], 1)}"
            raise UserError(f"episode {i} lies at {lies[0]} to {lies[1]}", file=path, expected=expected)
        at += e["length"]
    if at != total:
        raise UserError(f"total_frames is {total}; the episodes have {at}", file=folder / "meta/info.json")
