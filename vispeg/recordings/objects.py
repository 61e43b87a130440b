"""Recordings of a free object's motion, `vispeg-object-recording/1`: its pose over time, one episode per toss."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.paths import expanded
from vispeg.formats.format import Format, enrol
from vispeg.formats.typed import typed
from vispeg.recordings.columns import POSE
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Table
from vispeg.recordings.validate import check_episodes, check_finite, check_time, check_unit

FORMAT = "vispeg-object-recording/1"
KEYS = ("object", "rate_hz", "noise", "motion", "notes")
OBJECT = Format(FORMAT, "a recording of an object", KEYS, needed=KEYS[:2])
RATES = ("vx", "vy", "vz", "wx", "wy", "wz")
POSE_COLUMNS = [f"object.{tail}" for tail in POSE]
RATE_COLUMNS = [f"object.{tail}" for tail in RATES]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Noise(BaseModel):
    """1-sigma of a pose: m and rad."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    position: Positive | None = None
    angle: Positive | None = None


class Header(BaseModel):
    """recording.yaml of an object."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    object: Annotated[str, Field(min_length=1)]
    rate_hz: Positive
    noise: Noise = Noise()
    motion: str = ""
    notes: str = ""


@dataclass(frozen=True)
class ObjectRecording:
    """A free object's measured motion.

    Attributes:
        path: the folder (or a label where there is none).
        name_of: the object's body in the model.
        rate_hz: nominal sample rate.
        time: (n,) s, restarting in each episode.
        pose: (n, 7) x y z qw qx qy qz of the body in the world, m; no reading is missing.
        rate: (n, 6) velocity in the world, m/s, and angular velocity in the body's own frame, rad/s.
        episode: (n,) int; rows of one toss belong together.
        noise: 1-sigma of `position` (m) and `angle` (rad), only what is known.
        motion, notes: free text.
    """

    path: Path
    name_of: str
    rate_hz: float
    time: np.ndarray
    pose: np.ndarray
    rate: np.ndarray
    episode: np.ndarray
    noise: dict[str, float] = field(default_factory=dict)
    motion: str = ""
    notes: str = ""

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.path.name

    @property
    def tosses(self) -> list[slice]:
        """The rows of each episode."""
        starts = [0, *(np.flatnonzero(np.diff(self.episode)) + 1).tolist(), len(self.episode)]
        return [slice(a, b) for a, b in zip(starts[:-1], starts[1:], strict=True)]


def _example(folder: Path) -> Path:
    n = 20
    time = np.tile(np.arange(n // 2) / 100.0, 2)
    pose = np.tile([0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0], (n, 1))
    pose[:, 2] -= 4.9 * time**2
    made = ObjectRecording(folder / "toss", "cube", 100.0, time, pose, rates(pose, time, np.repeat([0, 1], 10)),
                           np.repeat([0, 1], 10), {"position": 1e-3})  # fmt: skip
    return write_object(made, folder / "toss")


@enrol(FORMAT, _example)
def load_object_recording(path: Path | str) -> ObjectRecording:
    """Load an object recording from a folder with recording.yaml and samples.csv or samples.parquet.

    If the table has no velocities, they are computed from the poses by central differences.

    Raises:
        UserError: anything missing, malformed or implausible, naming the file and the key, column or row.
    """
    folder = expanded(path)
    header_file = folder / "recording.yaml"
    if not header_file.is_file():
        raise UserError("holds no recording.yaml", file=folder)
    header = typed(Header, OBJECT.read(header_file), header_file)
    tables = [folder / name for name in ("samples.csv", "samples.parquet") if (folder / name).is_file()]
    if len(tables) != 1:
        raise UserError("needs one table", file=folder, expected="samples.csv or samples.parquet", got=len(tables))
    return _assemble(header, read_table(tables[0]), folder)


def _assemble(header: Header, table: Table, folder: Path) -> ObjectRecording:
    time = table.number("time")
    episode = np.zeros(len(time), np.int64)
    if "episode" in table.names:
        episode = check_episodes(table, table.number("episode"))
    check_time(table, time, episode, header.rate_hz)
    pose = _block(table, POSE_COLUMNS)
    check_unit(table, pose[:, 3:], "object")
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    measured = [name for name in RATE_COLUMNS if name in table.names]
    rate = _block(table, RATE_COLUMNS) if measured else rates(pose, time, episode)
    noise = header.noise.model_dump(exclude_none=True)
    return ObjectRecording(
        folder, header.object, header.rate_hz, time, pose, rate, episode, noise, header.motion, header.notes
    )


def _block(table: Table, columns: list[str]) -> np.ndarray:
    """Return columns side by side, (n, k). Raises UserError: a missing, infinite or impossibly large value."""
    values = np.stack([table.number(name) for name in columns], axis=1)
    check_finite(table, values, columns)
    rows, where = np.nonzero(np.isnan(values))
    if len(rows):
        key = f"{table.row(rows[0])}, column {columns[where[0]]}"
        raise UserError("is missing", file=table.file, key=key, expected="a pose in every row")
    if np.abs(values).max() > 1e6:
        raise UserError("is too large", file=table.file, expected="m, m/s and rad/s", got=float(np.abs(values).max()))
    return values


def rates(pose: np.ndarray, time: np.ndarray, episode: np.ndarray) -> np.ndarray:
    """Compute velocities (n, 6) of poses (n, 7) by central differences in each episode; see ObjectRecording.rate."""
    out = np.zeros((len(time), 6))
    for number in np.unique(episode):
        rows = np.flatnonzero(episode == number)
        if len(rows) < 2:
            continue
        before, after = np.r_[rows[0], rows[:-1]], np.r_[rows[1:], rows[-1]]
        span = (time[after] - time[before])[:, None]
        out[rows, :3] = (pose[after, :3] - pose[before, :3]) / span
        out[rows, 3:] = turn_between(pose[before, 3:], pose[after, 3:]) / span
    return out


def turn_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation vectors (n, 3) rad from orientation `a` to `b`, both (n, 4) wxyz, in the frame of `a`."""
    w = np.sum(a * b, axis=-1)
    v = a[..., :1] * b[..., 1:] - b[..., :1] * a[..., 1:] - np.cross(a[..., 1:], b[..., 1:])
    v = np.where(w[..., None] < 0, -v, v)
    sine = np.linalg.norm(v, axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, np.abs(w)[..., None])
    return v * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)  # angle / sine -> 2 without a turn


def write_object(recording: ObjectRecording, folder: Path | str, overwrite: bool = False, inputs: Any = ()) -> Path:
    """Write recording.yaml and samples.csv; reading gives the same numbers.

    Raises:
        UserError: the folder exists already or cannot be written.
    """
    head: dict[str, object] = {"format": FORMAT, "object": recording.name_of, "rate_hz": float(recording.rate_hz)}
    head |= {"noise": {k: float(v) for k, v in recording.noise.items()}} if recording.noise else {}
    head |= {"motion": recording.motion, "notes": recording.notes}
    names = ["time", "episode", *POSE_COLUMNS, *RATE_COLUMNS]
    columns = [recording.time, recording.episode, *recording.pose.T, *recording.rate.T]
    with new_folder(folder, overwrite, holds="recording", inputs=inputs) as part:
        (part / "recording.yaml").write_text(yaml.safe_dump(head, sort_keys=False, width=120), encoding="utf-8")
        with (part / "samples.csv").open("w", encoding="utf-8", newline="") as stream:
            stream.write(",".join(names) + "\n")
            stream.writelines(
                ",".join(map(repr, row)) + "\n" for row in zip(*(c.tolist() for c in columns), strict=True)
            )
    return Path(folder)
