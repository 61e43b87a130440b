"""Episode records: one line of JSON per episode, appended as episodes end, so that a killed evaluation can resume."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, BinaryIO

from vispeg.core.disk import written
from vispeg.core.errors import UserError
from vispeg.core.seeds import check_seed
from vispeg.formats.format import enrol
from vispeg.formats.guard import read_bytes
from vispeg.formats.json_data import parse_json

LARGEST = 2_000_000_000  # largest file of episodes, bytes
BLOCK = 65_536  # bytes that are read at once where the end of the last line is sought; few lines have more


@dataclass(frozen=True)
class Episode:
    """How one episode ended.

    Attributes:
        policy: the policy's name; replicas that differ in their training seed only share it.
        modality: what it observes (`state`, `proprio`, `depth`, `rgb`, `rgbd`, or a user's own).
        train_seed: seed of its training.
        world: the world's name.
        world_hash: SHA-256 of the world's content; "" for a measured target.
        seed: seed of the episode; the same seed gives the same start, goal and draw in every world and for every
            policy.
        success: whether the episode succeeded.
        category: how it ended: one of the task's categories, or a user's own word for a real robot's failure.
        time: duration of the episode, s.
        peak_force: largest contact force, N.
        lateral_error: distance of the tip from the goal's axis at the end, m.
        depth: depth of the tip below the goal's plane at the end, m.
        control: the control (see `vispeg.evaluation.controls`), "" for none.
        configuration: name of a suite's configuration, a sweep's value or a hard position, "" for none.
        force_profile: contact force at the policy's rate, N, or None.
        video: path of a video relative to the record's folder, or None.
        clipped: share of the steps in which the action exceeded what the controller accepts.
    """

    policy: str
    modality: str
    train_seed: int
    world: str
    world_hash: str
    seed: int
    success: bool
    category: str
    time: float = math.nan
    peak_force: float = math.nan
    lateral_error: float = math.nan
    depth: float = math.nan
    control: str = ""
    configuration: str = ""
    force_profile: tuple[float, ...] | None = None
    video: str | None = None
    clipped: float = math.nan

    @property
    def key(self) -> tuple[str, int, str, str, str, int]:
        """What identifies an episode: policy, training seed, world, control, configuration, seed."""
        return self.policy, self.train_seed, self.world, self.control, self.configuration, self.seed

    def to_json(self) -> str:
        """Return the episode as one line of JSON; NaN becomes null."""
        row = {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(self).items()}
        if self.force_profile is not None:
            row["force_profile"] = [float(f) for f in self.force_profile]
        return json.dumps(row, allow_nan=False)


def append(path: str | Path, episodes: Iterable[Episode]) -> None:
    """Append episodes to a JSON-lines file in one write; make the file if there is none.

    A half-written last line of a killed run is cut off first.

    Raises:
        UserError: the file cannot be written.
    """
    path = Path(path)
    text = "".join(e.to_json() + "\n" for e in episodes)
    with written(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with written(path), path.open("ab+") as file:
        file.truncate(_end_of_last_line(file))
        file.write(text.encode())
        file.flush()


def _example(folder: Path) -> Path:
    ends = [("success", True), ("jam", False)]
    made = [Episode("a", "depth", 0, "S", "0" * 64, i, won, end, 2.5, 8.0) for i, (end, won) in enumerate(ends)]
    append(folder / "episodes.jsonl", [replace(e, force_profile=(1.0, 8.0)) for e in made])
    return folder / "episodes.jsonl"


@enrol("episodes (JSON lines)", _example)
def read(path: str | Path) -> list[Episode]:
    """Return the episodes of a JSON-lines file, in order; a half-written last line is left out.

    Raises:
        UserError: the file cannot be read, a line is not an episode, or two lines are the same episode with different
            outcomes.
    """
    path = Path(path)
    data = read_bytes(path, LARGEST)
    by_key: dict[tuple[Any, ...], Episode] = {}
    for number, line in enumerate(data[: data.rfind(b"\n") + 1].split(b"\n"), start=1):
        if not line.strip():
            continue
        episode = _parse(line, path, number)
        other = by_key.setdefault(episode.key, episode)
        if (other.success, other.world_hash) != (episode.success, episode.world_hash):
            raise UserError("the same episode twice with different outcomes", file=path, key=f"line {number}")
    return list(by_key.values())


def read_all(paths: Iterable[str | Path]) -> list[Episode]:
    """Return the episodes of several files; an episode that is in several is returned once.

    Raises:
        UserError: as `read`; no episode at all, a world's name with two hashes, or an episode with different outcomes
            in two files.
    """
    by_key: dict[tuple[Any, ...], Episode] = {}
    source: dict[tuple[Any, ...], str | Path] = {}
    for path in paths:
        for e in read(path):
            other = by_key.setdefault(e.key, e)
            if (other.success, other.category) != (e.success, e.category) and other.world_hash == e.world_hash:
                key = f"{e.policy} (training seed {e.train_seed}) in {e.world}, seed {e.seed}"
                first = f"{other.category} as in {source[e.key]}"
                raise UserError(
                    "an episode ends differently in another file", file=path, key=key, expected=first, got=e.category
                )
            source.setdefault(e.key, path)
    if not by_key:
        raise UserError("no episodes", got=", ".join(map(str, paths)))
    check_worlds(by_key.values())
    return list(by_key.values())


def check_worlds(episodes: Iterable[Episode]) -> dict[str, str]:
    """Return the hash of each world, by `WORLD / CONFIGURATION / CONTROL` without empty parts.

    Raises:
        UserError: one name stands for two worlds.
    """
    hashes: dict[str, str] = {}
    for e in episodes:
        name = " / ".join(filter(None, (e.world, e.configuration, e.control)))  # a control may fix the goal
        if hashes.setdefault(name, e.world_hash) != e.world_hash:
            raise UserError("two different worlds under one name", key=name, expected=hashes[name], got=e.world_hash)
    return hashes


def _end_of_last_line(file: BinaryIO) -> int:
    """Return the position after the last line end of a file, 0 without one; it is sought in blocks from the end."""
    start = file.seek(0, os.SEEK_END)
    while start:
        size = min(BLOCK, start)
        start = file.seek(start - size)
        at = file.read(size).rfind(b"\n")
        if at >= 0:
            return start + at + 1
    return 0


def measure(key: str, value: Any, where: Mapping[str, Any]) -> float:
    """Return a measured number of an episode.

    Args:
        key: its name; only `depth` may be negative, above the goal's plane.
        value: the value that was read.
        where: `file` and `key` for the error.

    Raises:
        UserError: not a finite number, or a negative one where it must not be.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < math.inf:
        raise UserError(f"{key} is not a number", **where, expected="a finite number", got=value)
    if value < 0 and key != "depth":
        raise UserError(f"{key} is negative", **where, expected="0 or more", got=value)
    return float(value)


def _parse(line: bytes, path: Path, number: int) -> Episode:
    where = {"file": path, "key": f"line {number}"}
    row = parse_json(line, path, f"line {number}")
    if not isinstance(row, dict):
        raise UserError("is not an episode", **where, expected="an object", got=row)
    names = {f.name: f for f in fields(Episode)}
    if unknown := set(row) - set(names):
        raise UserError("unknown key", **where, got=sorted(unknown)[0], choices=names)
    types = {"policy": str, "modality": str, "train_seed": int, "world": str, "world_hash": str, "seed": int}
    types |= {"success": bool, "category": str}
    for key, kind in {"control": str, "configuration": str, **types}.items():
        value: Any = row.setdefault(key, "") if key not in types else row.get(key)
        if kind is int:
            check_seed(value, f"line {number}: {key}", path)
        elif type(value) is not kind:
            raise UserError(f"{key} is missing or of the wrong type", **where, expected=kind.__name__, got=value)
    for key in ("time", "peak_force", "lateral_error", "depth", "clipped"):
        value = row.get(key)
        row[key] = math.nan if value is None else measure(key, value, where)
    profile = row.get("force_profile")
    if not isinstance(profile, list | None) or not isinstance(row.get("video"), str | None):
        raise UserError("force_profile is not a list, or video is not a path", **where, got=profile)
    if profile is not None:
        row["force_profile"] = tuple(measure("force_profile", force, where) for force in profile)
    if row["success"] != (row["category"] == "success"):
        raise UserError(
            "success and category contradict each other", **where, got=f"{row['success']}, {row['category']}"
        )
    return Episode(**row)
