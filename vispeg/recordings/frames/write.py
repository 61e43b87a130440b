"""Writes `frames/` of a recording: the index, the cameras, and a PNG for each picture."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import yaml

from vispeg.core.errors import UserError
from vispeg.recordings.frames.camera import camera_entry
from vispeg.recordings.frames.frames import Frames, RecordedFrame, Source
from vispeg.recordings.frames.png import write_colour, write_steps
from vispeg.recordings.frames.read import CAMERAS, COLUMNS, EPISODE, FOLDER, INDEX


def write_frames(frames: Frames, folder: Path, episodes: bool = False) -> Path:
    """Write `frames/` into a recording's folder.

    Colour comes back bit for bit, depth to half a step of its camera's `depth_unit`; what was read from a file is
    copied as it is.

    Args:
        frames: what to write.
        folder: of the recording, which is there.
        episodes: whether the samples have an `episode` column.

    Returns:
        `folder/frames`.

    Raises:
        UserError: a picture of another size than its camera's, or a camera's name that no file can have.
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
