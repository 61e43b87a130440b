"""A file for the Rerun viewer while it is written: shapes, where they are over time, numbers and pictures."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.extras import require

SUFFIX, TIMELINE = ".rrd", "time"


def check_target(path: Path, overwrite: bool) -> None:
    """Raise UserError, before any work is begun, where no .rrd file can be written to `path`."""
    require("rerun", "--rerun")
    if path.suffix != SUFFIX:
        raise UserError("a Rerun recording has another ending", key="--rerun", expected=f"FILE{SUFFIX}", got=path.name)
    if path.is_dir():
        raise UserError("is a folder", file=path, key="--rerun", expected=f"a file {SUFFIX}")
    if path.exists() and not overwrite:
        raise UserError("exists already; name another or pass --overwrite", file=path)


def entity(*parts: str) -> str:
    """Give the path of an entity; a part may be any name."""
    import rerun as rr

    return rr.new_entity_path([part or "unnamed" for part in parts])


class Stream:
    """What is logged into one file. Times are s, on one timeline; entities are paths as `entity` gives them."""

    def __init__(self, recording: Any):
        self.recording = recording

    def mesh(self, at: str, vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray, alpha: int = 255) -> None:
        """Triangles (F, 3) of vertices (V, 3) m in the entity's axes, at all times; `colours` (V, 3) uint8."""
        import rerun as rr

        factor = None if alpha == 255 else [255, 255, 255, alpha]
        opaque = np.column_stack([colours, np.full(len(colours), alpha, np.uint8)])
        shape = rr.Mesh3D(vertex_positions=vertices, triangle_indices=faces, vertex_colors=opaque, albedo_factor=factor)
        self.recording.log(at, shape, static=True)

    def place(self, at: str, time: np.ndarray, pos: np.ndarray, quat: np.ndarray) -> None:
        """Where an entity is at times (T,): `pos` (T, 3) m and `quat` (T, 4) wxyz in the world's axes."""
        import rerun as rr

        columns = rr.Transform3D.columns(translation=pos, quaternion=quat[:, [1, 2, 3, 0]])
        self.recording.send_columns(at, self._index(time), columns)

    def lines(self, parts: Sequence[str], time: np.ndarray, lines: Mapping[str, np.ndarray]) -> None:
        """Numbers over time beneath an entity, name -> (T,); what is not finite is left out."""
        import rerun as rr

        for name, values in lines.items():
            there = np.isfinite(values)
            columns = rr.Scalars.columns(scalars=values[there])
            self.recording.send_columns(entity(*parts, name), self._index(time[there]), columns)

    def picture(self, at: str, time: float, image: np.ndarray) -> None:
        """Give a picture (H, W, 3) uint8 at a time."""
        import rerun as rr

        self.recording.set_time(TIMELINE, duration=time)
        self.recording.log(at, rr.Image(image).compress(jpeg_quality=85))

    def say(self, at: str, time: float, text: str) -> None:
        """Give a line of text at a time."""
        import rerun as rr

        self.recording.set_time(TIMELINE, duration=time)
        self.recording.log(at, rr.TextLog(text))

    def arrange(self, *views: Any) -> None:
        """How the viewer opens: views of `rerun.blueprint`."""
        import rerun.blueprint as rrb

        self.recording.send_blueprint(rrb.Blueprint(*views, collapse_panels=True))

    @staticmethod
    def _index(time: np.ndarray) -> list[Any]:
        import rerun as rr

        return [rr.TimeColumn(TIMELINE, duration=np.asarray(time, float))]


@contextmanager
def stream(path: Path, title: str) -> Iterator[Stream]:
    """Give a file that takes its name when the body is done; nothing is left where it fails.

    Raises:
        UserError: the extra `viz` is missing, or the file cannot be written.
    """
    require("rerun", "--rerun")
    import rerun as rr

    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.touch()
    except OSError as error:
        raise UserError(f"cannot be written: {error.strerror}", file=path) from error
    recording = rr.RecordingStream("vispeg", recording_id=title)
    try:
        recording.save(str(part))
        yield Stream(recording)
        recording.flush()
        recording.disconnect()
        os.replace(part, path)
    finally:
        recording.disconnect()
        part.unlink(missing_ok=True)
