"""Folders in LeRobot's layouts, version 3 and 2.1, pictures in tables or videos, as a robot's logger writes them."""

import json
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

COUNTED = ("timestamp", "frame_index", "episode_index", "index", "task_index")
TABLE = {"v3.0": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"}
TABLE["v2.1"] = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
VIDEO = {"v3.0": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"}
VIDEO["v2.1"] = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"


def write(folder, episodes, names, fps=6.25, version="v3.0", video=False):
    """Write episodes: arrays (T, ...) by feature, of pictures a list of encoded bytes, or (T, H, W, 3) for videos.

    Args:
        folder: new.
        episodes: as said.
        names: of the numbers of each feature that has them; of a picture its height and width.
        fps: frames a second.
        version: v3.0 or v2.1.
        video: whether pictures come as videos.
    """
    v3, tables, rows, at = version == "v3.0", [], [], 0
    pictures = [key for key in episodes[0] if key.startswith("observation.images.")]
    for e, episode in enumerate(episodes):
        n = len(episode["action"])
        columns = {key: pa.array(list(value)) for key, value in episode.items() if key not in pictures}
        for key in () if video else pictures:
            columns[key] = pa.array([{"bytes": b, "path": None} for b in episode[key]])
        steps = np.arange(n)
        counted = (np.float32(steps / fps), steps, np.full(n, e), at + steps, np.zeros(n, int))
        tables.append(pa.table(columns | dict(zip(COUNTED, map(pa.array, counted), strict=True))))
        row = {"episode_index": e, "length": n, "dataset_from_index": at, "dataset_to_index": at + n}
        row |= {"data/chunk_index": 0, "data/file_index": 0}
        for key in pictures if video else ():
            row |= {
                f"videos/{key}/chunk_index": 0,
                f"videos/{key}/file_index": 0,
                f"videos/{key}/from_timestamp": at / fps,
            }
        rows.append(row)
        at += n
    place = {"chunk_index": 0, "file_index": 0, "episode_chunk": 0}
    stored = (
        [(pa.concat_tables(tables), place)] if v3 else [(t, place | {"episode_index": i}) for i, t in enumerate(tables)]
    )
    for table, numbers in stored:
        file = folder / TABLE[version].format(**numbers)
        file.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(table, file)
    for key in pictures if video else ():
        clips = [episode[key] for episode in episodes]
        for i, clip in enumerate([np.concatenate(clips)] if v3 else clips):
            film(folder / VIDEO[version].format(video_key=key, episode_index=i, **place), clip, fps)
    features = {key: {"dtype": "float32", "shape": [1], "names": None} for key in COUNTED[:1]}
    features |= {key: {"dtype": "int64", "shape": [1], "names": None} for key in COUNTED[1:]}
    for key, value in episodes[0].items():
        if key in pictures:
            kind, shape = "video" if video else "image", [*names[key], 3]
            features[key] = {"dtype": kind, "shape": shape, "names": ["height", "width", "channels"]}
        else:
            value = np.asarray(value)
            features[key] = {"dtype": str(value.dtype), "shape": [*value.shape[1:]] or [1], "names": names.get(key)}
    info = {"codebase_version": version, "robot_type": "iiwa", "total_episodes": len(rows), "total_frames": at}
    info |= {"fps": fps, "chunks_size": 1000, "features": features, "data_path": TABLE[version]}
    info |= {"video_path": VIDEO[version] if video else None}
    meta = folder / "meta"
    if v3:
        (meta / "episodes" / "chunk-000").mkdir(parents=True)
        pq.write_table(pa.Table.from_pylist(rows), meta / "episodes" / "chunk-000" / "file-000.parquet")
    else:
        meta.mkdir(parents=True)
        lines = [{"episode_index": r["episode_index"], "tasks": ["Do it."], "length": r["length"]} for r in rows]
        (meta / "episodes.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    (meta / "info.json").write_text(json.dumps(info))
    return folder


def film(file: Path, frames, fps):
    """Write a video of frames (T, H, W, 3) uint8 that loses no more than its colours do."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(file), "w") as out:
        stream = out.add_stream("libx264", rate=Fraction(fps))
        stream.height, stream.width = frames.shape[1:3]
        stream.pix_fmt, stream.options = "yuv444p", {"qp": "0"}
        for frame in frames:
            out.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        out.mux(stream.encode(None))
