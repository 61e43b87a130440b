"""Read and check a dataset's description in `meta/`: features, totals, cameras, and how it was made."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Formatter
from typing import Any, TypedDict, TypeGuard, cast

from vispeg.core.errors import UserError
from vispeg.datasets.layout import COUNTED, NUMBERS, Feature, Info, colour_of, depth_of, is_depth, pixel_shape
from vispeg.formats.format import Format
from vispeg.formats.guard import is_file
from vispeg.formats.json_data import read_json
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import from_record

INFO, STATS, TASKS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"
CAMERAS, RENDER = "meta/cameras.json", "meta/render.json"
BOP_CAMERA = "scene_camera.json"  # file of each scene in BOP's layout
CAMERA_FILE = Format("vispeg-cameras/1", "a dataset's cameras", ("cameras", "parts"), ("cameras",), "json")
RENDER_FILE = Format("vispeg-dataset/1", "how a dataset was made", ("plan", "files", "provenance"), (), "json")
PLACES = ("chunk_index", "file_index")  # the two numbers that `data_path` has placeholders for
EACH = ("episode_chunk", "episode_index")  # the same in older versions, which have one file per episode
BEFORE: Mapping[str, tuple[str, str]] = {"v2.0": EACH, "v2.1": EACH}  # older version -> its placeholders
PLACE = re.compile(r"(0?[1-9])?d?")  # allowed format specifications of the placeholders, such as `03d`
ENTRIES = 10**9  # most numbers of a feature in one frame
MOST_FRAMES = 10**9


class Made(TypedDict, total=False):
    """How a dataset was rendered; empty if this program did not render it."""

    plan: Mapping[str, Any]
    files: Mapping[str, str]
    provenance: Mapping[str, object]


def read_info(folder: Path, versions: Sequence[str]) -> Info:
    """Read `meta/info.json`, which must be of one of these versions.

    Raises:
        UserError: no dataset, an unfinished one, another version, or an impossible value; the error names the key.
    """
    path = folder / INFO
    if is_bop(folder):
        what = (
            "is a dataset in BOP's layout, which `vispeg dataset show`, `vispeg dataset check` and `vispeg view` read"
        )
        raise UserError(what, file=folder, expected=f"one in LeRobot's layout, a folder with {INFO}")
    if not is_file(path):
        unfinished = folder.with_name(folder.name + ".unfinished") if folder.name else folder
        begun = folder.name.endswith(".unfinished") or (unfinished.is_dir() and not folder.exists())
        hint = "is an unfinished rendering: repeat the `vispeg render` that began it" if begun else "is not a dataset"
        raise UserError(hint, file=folder, expected=f"a folder with {INFO}")
    info = read_json(path)
    version = info.get("codebase_version") if isinstance(info, dict) else info
    if version not in versions:
        raise UserError(
            "another version", file=path, key="codebase_version", expected=" or ".join(versions), got=version
        )
    for key in ("features", "total_frames", "fps", "data_path"):
        if key not in info:
            raise UserError("is missing", file=path, key=key)
    total, fps = info["total_frames"], info["fps"]
    if not is_integer(total) or not 1 <= total <= MOST_FRAMES:
        raise UserError("not a number of frames", file=path, key="total_frames", expected="1 or more", got=total)
    if not is_number(fps) or not 0 < fps <= 1e6:
        raise UserError("not a rate", file=path, key="fps", expected="frames a second", got=fps)
    check_features(info["features"], path)
    _check_path(info["data_path"], path, BEFORE.get(str(version), PLACES))
    return cast("Info", info)


def is_bop(folder: Path) -> bool:
    """Return whether a folder looks like a dataset in BOP's layout."""
    return not is_file(folder / INFO) and any(folder.glob(f"*/*/{BOP_CAMERA}"))


def check_features(features: Any, path: Path) -> None:
    """Raise UserError if an entry is not a feature, or a feature that every dataset has is missing."""
    if not isinstance(features, dict):
        raise UserError("not a mapping of features", file=path, key="features", got=features)
    if missing := [name for name in COUNTED if name not in features]:
        raise UserError("is missing", file=path, key=f"features.{missing[0]}")
    for name, feature in features.items():
        key = f"features.{name}"
        if not isinstance(feature, dict):
            raise UserError("not a feature", file=path, key=key, expected="dtype, shape, names", got=feature)
        dtype: Any = feature.get("dtype")
        shape: Any = feature.get("shape")
        if dtype not in (*NUMBERS, "image", "video", "string"):
            choices = (*NUMBERS, "image", "string")
            raise UserError("not a supported type", file=path, key=f"{key}.dtype", got=dtype, choices=choices)
        right = isinstance(shape, list) and shape and all(is_integer(n) and n >= 1 for n in shape)
        if not right or math.prod(shape) > ENTRIES or (name in COUNTED and shape != [1]):
            raise UserError("not a shape", file=path, key=f"{key}.shape", expected="a list of counts", got=shape)
        if dtype == "image" and (len(shape) != 3 or shape[2] not in (1, 3)):
            expected = "[height, width, 1 or 3]"
            raise UserError("not a picture's shape", file=path, key=f"{key}.shape", expected=expected, got=shape)
        for entry, kinds in (("names", (list, dict)), ("info", (dict,))):
            if feature.get(entry) is not None and not isinstance(feature[entry], kinds):
                raise UserError("has the wrong type", file=path, key=f"{key}.{entry}", got=feature[entry])
        unit = (feature.get("info") or {}).get("depth_unit", "m")
        if unit != "m":
            raise UserError("another unit", file=path, key=f"{key}.info.depth_unit", expected="m", got=unit)
        if is_depth(cast("Feature", feature)) and len(shape) == 1:
            raise UserError(
                "not a picture's shape", file=path, key=f"{key}.shape", expected="[height, width]", got=shape
            )


def _check_path(pattern: Any, path: Path, places: Sequence[str]) -> None:
    """Raise UserError if `data_path` is not a path below the folder, with placeholders among `places` only."""
    chunk, file = places
    expected = f"a file below the folder, such as data/chunk-{{{chunk}:03d}}/file-{{{file}:03d}}.parquet"
    try:
        fields = [part[1:] for part in Formatter().parse(pattern) if part[1] is not None]  # without plain text
        valid = all(key in places and not how and PLACE.fullmatch(spec or "") for key, spec, how in fields)
        name = pattern.format(**dict.fromkeys(places, 0)) if valid else ""
    except (ValueError, TypeError, IndexError, KeyError, AttributeError):
        name = ""
    if not inside(name):
        raise UserError("does not name the data files", file=path, key="data_path", expected=expected, got=pattern)


def inside(name: Any) -> bool:
    """Return whether a name is a relative path that stays below its folder."""
    right = isinstance(name, str) and bool(name) and "\0" not in name and len(name) < 1000
    return right and not Path(name).is_absolute() and ".." not in Path(name).parts


def read_cameras(folder: Path, features: Mapping[str, Feature]) -> tuple[dict[str, Camera], tuple[str, ...]]:
    """Read the nominal cameras by name, and the names of the parts; empty if the dataset does not state them.

    Raises:
        UserError: an impossible camera, or one whose pictures are missing or have another size.
    """
    path = folder / CAMERAS
    if not os.path.lexists(path):
        return {}, ()
    record = CAMERA_FILE.read(path)
    parts = record.get("parts", [])
    if not isinstance(parts, list) or not all(isinstance(p, str) for p in parts) or len(set(parts)) < len(parts):
        raise UserError("not a list of names", file=path, key="parts", got=parts)
    return cameras_of(record["cameras"], features, path), tuple(parts)


def cameras_of(records: Any, features: Mapping[str, Feature], path: Path, key: str = "cameras") -> dict[str, Camera]:
    """Make cameras from their records, by name.

    Raises:
        UserError: an impossible camera, or one whose pictures are missing or have another size.
    """
    if not isinstance(records, list):
        raise UserError("not a list of cameras", file=path, key=key, got=records)
    cameras = [from_record(record, path) for record in records]
    for i, camera in enumerate(cameras):
        if camera.name in [other.name for other in cameras[:i]]:
            raise UserError("two cameras of one name", file=path, key=key, got=camera.name)
        colour, deep = colour_of(camera.name), depth_of(camera.name, features)
        if colour not in features:
            raise UserError("a camera without pictures", file=path, key=key, expected=colour, got=camera.name)
        for name in (colour, deep) if deep in features else (colour,):
            size = pixel_shape(features[name])[:2]
            if size != (camera.height, camera.width):
                expected, got = f"{size[1]} x {size[0]} px as {name}", f"{camera.width} x {camera.height}"
                place = f"{key}.{camera.name}"
                raise UserError("another size than its pictures", file=path, key=place, expected=expected, got=got)
    return {camera.name: camera for camera in cameras}


def read_made(folder: Path) -> Made:
    """Read how a dataset was rendered: plan, digests of files, provenance; {} if this program did not render it."""
    path = folder / RENDER
    if not os.path.lexists(path):
        return {}
    record = RENDER_FILE.read(path)
    for key, value in record.items():
        if not isinstance(value, dict):
            raise UserError("not a mapping", file=path, key=key, got=value)
    for key, value in record.get("plan", {}).items():
        entries = value if isinstance(value, list) else [value]
        if not all(isinstance(entry, str | int | float) for entry in entries):
            raise UserError("not a setting of a rendering", file=path, key=f"plan.{key}", got=value)
    for name, digest in record.get("files", {}).items():
        if not inside(name) or not isinstance(digest, str):
            raise UserError("not a file's digest", file=path, key=f"files.{name}", got=digest)
    return cast("Made", record)


def read_stats(folder: Path) -> Mapping[str, Mapping[str, object]]:
    """Read `meta/stats.json`; return {} if there is none."""
    path = folder / STATS
    stats = read_json(path) if os.path.lexists(path) else {}
    if not isinstance(stats, dict) or not all(isinstance(entry, dict) for entry in stats.values()):
        raise UserError("not a mapping of features to statistics", file=path)
    return stats


def is_integer(value: Any) -> TypeGuard[int]:
    """Return whether a value is a whole number."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_number(value: Any) -> TypeGuard[float]:
    """Return whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
