"""Read and write `frames/` of a recording: the index, the cameras, and the pictures, which are loaded on demand."""

from __future__ import annotations

import csv
import io
import math
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.formats.guard import is_file, read_text
from vispeg.recordings.frames.camera import RecordedCamera, camera_entry, read_cameras
from vispeg.recordings.frames.frames import Frames, RecordedFrame, Source
from vispeg.recordings.frames.png import head, write_colour, write_steps

FOLDER, INDEX, CAMERAS = "frames", "index.csv", "cameras.yaml"
COLUMNS = ("time", "camera", "rgb", "depth")
EPISODE = "episode"
KINDS = {"rgb": (8, "an 8-bit picture in colour or grey"), "depth": (16, "a 16-bit picture of one channel")}
LARGEST = 64_000_000  # bytes of an index: half a million frames


def read_frames(folder: Path, time: np.ndarray, episode: np.ndarray | None) -> Frames | None:
    """Read the frames in a recording's folder; None if it has no `frames/`.

    Frames before the first or after the last sample of their episode are dropped with one warning, as a camera may run
    longer than the robot's log. If no frame at all lies within the samples' times, the clocks differ: an error.

    Args:
        folder: of the recording.
        time, episode: (n,) of the samples.

    Raises:
        UserError: a missing file, an invalid row or camera, a picture whose size or kind differs from its camera's, or
            no frame within the samples' times.
    """
    place = folder / FOLDER
    try:
        if not place.is_dir():
            return None
    except (OSError, ValueError):
        return None
    cameras, unknown = read_cameras(place / CAMERAS)
    rows = _rows(place / INDEX)
    frames = [_frame(place, cameras, line, row) for line, row in rows]
    frames = _within(place / INDEX, frames, time, episode)
    _check_order(place / INDEX, frames)
    spare = [name for name in cameras if name not in {frame.camera.name for frame in frames}]
    if spare:
        note(f"{place / INDEX}: no frame of the cameras {', '.join(spare)}")
    if unknown:
        note(f"{place / CAMERAS}: unknown keys are ignored: {', '.join(unknown[:8])}")
    return Frames(cameras, tuple(frames))


def _rows(file: Path) -> list[tuple[int, dict[str, str]]]:
    """Read line number and cells of each row."""
    if not is_file(file):
        raise UserError("no such file", file=file, expected=f"a table with the columns {', '.join(COLUMNS)}")
    reader = csv.reader(io.StringIO(read_text(file, LARGEST), newline=""), strict=True)
    try:
        names = [name.strip() for name in next(reader, [])]
        for column in COLUMNS[:2]:
            if names.count(column) != 1:
                raise UserError("column is missing, or there twice", file=file, key=column, got=", ".join(names))
        if not set(names) & set(COLUMNS[2:]):
            raise UserError("has no pictures", file=file, expected="a column rgb or depth", got=", ".join(names))
        extra = [name for name in names if name not in (*COLUMNS, EPISODE)]
        if extra:
            note(f"{file}: unknown columns are ignored: {', '.join(extra[:8])}")
        out = []
        for cells in reader:
            if not cells:
                continue
            if len(cells) != len(names):
                key = f"line {reader.line_num}"
                raise UserError("wrong number of cells", file=file, key=key, expected=len(names), got=len(cells))
            out.append((reader.line_num, dict(zip(names, cells, strict=True))))
    except csv.Error as error:
        raise UserError(f"is not a table ({error})", file=file, key=f"line {reader.line_num}") from None
    if not out:
        raise UserError("holds no frames", file=file)
    return out


def _frame(place: Path, cameras: dict[str, RecordedCamera], line: int, row: dict[str, str]) -> RecordedFrame:
    file = place / INDEX
    name = row["camera"].strip()
    if name not in cameras:
        raise UserError("no such camera in cameras.yaml", file=file, key=f"line {line}", got=name, choices=cameras)
    camera, number = cameras[name], _number(file, line, row["time"], "time")
    episode = _number(file, line, row[EPISODE], EPISODE) if EPISODE in row else 0.0
    if episode != math.floor(episode) or abs(episode) >= 2**53:
        raise UserError("is not a whole number", file=file, key=f"line {line}, column {EPISODE}", got=row[EPISODE])
    sources: dict[str, Path] = {}
    for kind in KINDS:
        picture = row.get(kind, "").strip()
        if picture:
            sources[kind] = _picture(place, picture, camera, kind, line)
    if not sources:
        raise UserError("has no picture", file=file, key=f"line {line}", expected="a file under rgb or depth")
    return RecordedFrame(number, camera, sources.get("rgb"), sources.get("depth"), int(episode))


def _number(file: Path, line: int, text: str, column: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UserError("is not a finite number", file=file, key=f"line {line}, column {column}", got=text)
    return value


def _picture(place: Path, name: str, camera: RecordedCamera, kind: str, line: int) -> Path:
    """Return a picture's file after checking that its PNG header agrees with its camera."""
    path = place / name
    if Path(name).is_absolute() or ".." in Path(name).parts:
        expected = "a name below frames/"
        raise UserError("leads out of frames/", file=place / INDEX, key=f"line {line}", expected=expected, got=name)
    if not is_file(path):
        raise UserError("no such picture", file=place / INDEX, key=f"line {line}, column {kind}", got=name)
    about, (bits, expected) = head(path), KINDS[kind]
    if about.bits != bits or (kind == "depth" and about.colours != 1):
        raise UserError("has the wrong type", file=path, expected=expected, got=f"{about.bits} bits a channel")
    if (about.width, about.height) != (camera.width, camera.height):
        expected = f"{camera.width} x {camera.height} px, as camera '{camera.name}' in {CAMERAS}"
        raise UserError("has another size", file=path, expected=expected, got=f"{about.width} x {about.height}")
    return path


def _within(
    file: Path, frames: Sequence[RecordedFrame], time: np.ndarray, episode: np.ndarray | None
) -> list[RecordedFrame]:
    """Keep the frames within the samples' times, sorted by episode and time; without `episode` all are one."""
    inside: list[RecordedFrame] = []
    numbers = [0] if episode is None else list(dict.fromkeys(episode.tolist()))
    # a single episode has all frames, whatever one number the index states; of several, samples may have one left
    if episode is None or (len(numbers) == 1 and len({frame.episode for frame in frames}) == 1):
        frames = [replace(frame, episode=numbers[0]) for frame in frames]
    for number in numbers:
        clock = time if episode is None else time[episode == number]
        mine = [f for f in frames if f.episode == number and clock[0] <= f.time <= clock[-1]]
        inside += sorted(mine, key=lambda f: f.time)
    outside = len(frames) - len(inside)
    if outside:
        said = f"{outside} of {count(len(frames), 'frame')} outside the times of the samples"
        if not inside:
            raise UserError(said, file=file, expected=f"times from {float(time.min()):g} to {float(time.max()):g} s")
        note(f"{file}: {said}: left out")
    return inside


def _check_order(file: Path, frames: Sequence[RecordedFrame]) -> None:
    """Check that no camera has two frames at one time."""
    earlier: set[tuple[int, str, float]] = set()
    for frame in frames:
        key = frame.episode, frame.camera.name, frame.time
        if key in earlier:
            got = f"camera {frame.camera.name}, time {frame.time!r}"
            raise UserError("two frames of one camera at one time", file=file, got=got)
        earlier.add(key)


def write_frames(frames: Frames, folder: Path, episodes: bool) -> Path:
    """Write `frames/` into a recording's folder.

    Reading them back gives identical colour, and depth to within half a step of the camera's `depth_unit`; pictures
    that come from a file are copied unchanged.

    Args:
        frames: what to write.
        folder: the recording's folder, which must exist.
        episodes: whether the samples have an `episode` column.

    Returns:
        `folder/frames`.

    Raises:
        UserError: a picture whose size differs from its camera's, or a camera name that is no valid file name.
    """
    place = folder / FOLDER
    place.mkdir()
    columns = (*COLUMNS, EPISODE) if episodes else COLUMNS
    rows, count = [",".join(columns)], dict.fromkeys(frames.cameras, 0)
    for frame in frames:
        name = frame.camera.name
        if not name.isprintable() or set(name) & set('/\\,"') or name != name.strip() or not name.strip("."):
            raise UserError("cannot be a file's name", file=place, key="camera", got=name)
        stem, cells = f"{name}-{count[name]:05d}", [repr(float(frame.time)), name]
        count[name] += 1
        for kind, source in (("rgb", frame.rgb_source), ("depth", frame.depth_source)):
            cells.append("" if source is None else f"{stem}-{kind}.png")
            if source is not None:
                _write(place / cells[-1], source, kind, frame)
        rows.append(",".join([*cells, str(frame.episode)] if episodes else cells))
    (place / INDEX).write_text("\n".join(rows) + "\n", encoding="utf-8")
    text = yaml.safe_dump(
        {name: camera_entry(camera) for name, camera in frames.cameras.items()},
        sort_keys=False,
        default_flow_style=None,
        width=120,
        allow_unicode=True,
    )
    (place / CAMERAS).write_text(text, encoding="utf-8")
    return place


def _write(file: Path, source: Source, kind: str, frame: RecordedFrame) -> None:
    if isinstance(source, Path):
        shutil.copyfile(source, file)
        return
    image, camera = np.asarray(source), frame.camera
    if image.shape[:2] != (camera.height, camera.width):
        expected = f"({camera.height}, {camera.width}) px, as camera '{camera.name}'"
        raise UserError("has another size", file=file, expected=expected, got=image.shape)
    if kind == "rgb":
        write_colour(file, image)
    else:
        write_steps(file, image, camera.depth_unit)
