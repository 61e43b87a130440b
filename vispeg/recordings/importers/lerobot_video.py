"""Import the pictures of a LeRobot data set: PyAV decodes its videos at the times of the samples.

Format 2 has one video per episode; format 3 puts several episodes in one video, with their start times in
meta/episodes. In both, `video_path` in meta/info.json is the pattern of the files' paths.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.formats.guard import as_written, refuse_special
from vispeg.formats.json_data import read_json
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames
from vispeg.recordings.importers.bagimages import EVERY
from vispeg.recordings.importers.pictures import Album
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.read import parts, read_table
from vispeg.recordings.tables.table import Reading

PREFIX, EPISODE = "observation.images.", "episode_index"


def root_of(table: Path) -> Path | None:
    """Return the folder of the LeRobot data set that contains a table; None if there is none."""
    return next(
        (folder for folder in (table.resolve(), *table.resolve().parents) if (folder / "meta" / "info.json").is_file()),
        None,
    )


def import_video(
    table: Path, rec: Recording, wanted: Sequence[str], cameras: Mapping[str, RecordedCamera], scratch: Path
) -> Frames | None:
    """Return the pictures at the sample times of a recording that was imported from a LeRobot table.

    Args:
        table: a parquet file of the data set.
        rec: the recording; its episodes are the table's, its times count from an episode's first sample.
        wanted: keys of videos such as `observation.images.wrist` (or `wrist`), or `all`.
        cameras: intrinsics and poses, by the last word of the video's key.
        scratch: folder for the pictures until the recording is written.

    Raises:
        UserError: the table is in no data set, its episodes have other numbers than the recording's, an unknown key, a
            missing or damaged video, or PyAV is not installed.
    """
    root = root_of(table)
    if root is None:
        raise UserError(
            "belongs to no LeRobot data set", file=table, key="--images", expected="meta/info.json above it"
        )
    info = read_json(root / "meta" / "info.json")
    with as_written(root / "meta" / "info.json", "LeRobot"):
        kinds = {key: feature["dtype"] for key, feature in info["features"].items()}
        pattern, chunk = str(info.get("video_path") or ""), int(info.get("chunks_size") or 1000)
    keys = _keys(wanted, kinds, root)
    require("av", "a video")
    album = Album(scratch)
    episodes = rec.episode if rec.episode is not None else np.zeros(len(rec.time), np.int64)
    _refuse_numbers(table, episodes)
    for key in keys:
        for episode in dict.fromkeys(episodes.tolist()):
            file, start = where(root, pattern, key, int(episode), chunk)
            times = rec.time[episodes == episode]
            for time, image in decoded(file, times, start):
                album.add(key.removeprefix(PREFIX), time, image, int(episode))
    return album.frames(rec, cameras)


def _refuse_numbers(table: Path, episodes: np.ndarray) -> None:
    """Raise UserError if a sample's episode (n,) is none of the table's, so that its video would be another's."""
    column = Reading(keep=lambda _: [EPISODE])
    there = np.concatenate([read_table(file, column).number(EPISODE) for file in parts(table) or [table]])
    strange = np.setdiff1d(episodes, there)
    if len(strange):
        expected, got = f"`episode: {EPISODE}` in the map, and a clock that does not step back", int(strange[0])
        raise UserError("has no such episode", file=table, key="--images", expected=expected, got=got)


def _keys(wanted: Sequence[str], kinds: Mapping[str, Any], root: Path) -> list[str]:
    """Return the keys of the requested videos. Raises UserError: there is none, or none of that name."""
    videos = [key for key, kind in kinds.items() if kind == "video"]
    if tuple(wanted) == (EVERY,):
        if not videos:
            raise UserError("holds no videos", file=root, key="--images")
        return videos
    out = []
    for name in wanted:
        key = name if name in videos else PREFIX + name
        if key not in videos:
            raise UserError("no such video", file=root, key="--images", got=name, choices=videos)
        out.append(key)
    return out


def where(root: Path, pattern: str, key: str, episode: int, chunk: int) -> tuple[Path, float]:
    """Return an episode's video file and the episode's start time in it, s. Raises UserError: there is no such file.

    `chunk` is the number of episodes to a folder, in format 2.
    """
    words: dict[str, str | int] = {"video_key": key, "episode_index": episode, "episode_chunk": episode // chunk}
    start = 0.0
    if "{file_index" in pattern:
        row = _episode(root, key, episode)
        words |= {"chunk_index": int(row["chunk_index"]), "file_index": int(row["file_index"])}
        start = float(row["from_timestamp"])
    try:
        file = root / pattern.format(**words)
    except (KeyError, ValueError, IndexError) as error:
        raise UserError("has no usable video_path", file=root / "meta" / "info.json", got=pattern) from error
    if not file.is_file():
        raise UserError("no such video", file=file)
    return file, start


def _episode(root: Path, key: str, episode: int) -> dict[str, float]:
    """Read the entries of meta/episodes about an episode's video."""
    import pyarrow.parquet as pq

    names = ("chunk_index", "file_index", "from_timestamp")
    for file in sorted((root / "meta" / "episodes").rglob("*.parquet")):
        refuse_special(file)
        with as_written(file, "LeRobot"):
            table = pq.read_table(file, columns=["episode_index", *(f"videos/{key}/{n}" for n in names)]).to_pydict()
            if episode in table["episode_index"]:
                at = table["episode_index"].index(episode)
                return {n: table[f"videos/{key}/{n}"][at] for n in names}
    raise UserError("has no such episode", file=root / "meta" / "episodes", got=episode)


def decoded(file: Path, times: np.ndarray, start: float) -> Iterator[tuple[float, np.ndarray]]:
    """Yield each time (s, from the episode's beginning) and the picture that the video shows then, (H, W, 3) uint8.

    A time at which the video has no frame is left out, and of several in one frame's period all but the nearest to it.
    Raises UserError: no video.
    """
    import av
    from av.error import FFmpegError

    try:
        with av.open(str(file)) as video:
            stream = video.streams.video[0]
            half = float(0.5 / stream.average_rate) if stream.average_rate else 0.0  # s, half a frame's period
            waiting = list(enumerate(np.sort(times + start)))
            order = np.argsort(times, kind="stable")
            if start > 0 and stream.time_base:
                video.seek(int(max(0.0, start - 1e-3) / stream.time_base), stream=stream)
            for frame in video.decode(stream):
                if not waiting:
                    break
                if frame.time is None:
                    continue
                while waiting and waiting[0][1] < frame.time - half - 1e-6:
                    waiting.pop(0)  # the video has no frame at this time
                shown = []
                while waiting and waiting[0][1] <= frame.time + half:
                    shown.append(waiting.pop(0))
                if shown:
                    number, _ = min(shown, key=lambda one: abs(one[1] - frame.time))
                    yield float(times[order[number]]), frame.to_ndarray(format="rgb24")
    except (FFmpegError, IndexError, ValueError) as error:
        raise UserError(f"is not a video that can be decoded ({error})", file=file) from error
