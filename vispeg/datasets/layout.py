"""The content of a dataset: its features, named as in LeRobotDataset v3.0, its cameras, and its rate.

The format is LeRobot's, see docs/datasets.md. A feature is a mapping with `dtype`, `shape` and `names`. Only colour is
`dtype: image`, because LeRobot's policies take every such feature for a camera of three channels. Depth and part
numbers are arrays (H, W). Older datasets have them as pictures under other names, and can be read too.
"""

from __future__ import annotations

import json
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NotRequired, TypedDict

import numpy as np

from vispeg.render.cameras.camera import Camera

if TYPE_CHECKING:
    import pyarrow as pa

VERSION = "v3.0"
COLOUR = "observation.images."  # prefix of a camera's name


class Feature(TypedDict):
    """The description of a feature in `meta/info.json`."""

    dtype: str
    shape: list[int]
    names: list[str] | Mapping[str, object] | None
    info: NotRequired[Mapping[str, object] | None]


class Info(TypedDict):
    """The content of `meta/info.json`."""

    codebase_version: str
    robot_type: NotRequired[str]
    total_episodes: NotRequired[int]
    total_frames: int
    total_tasks: NotRequired[int]
    chunks_size: NotRequired[int]
    data_files_size_in_mb: NotRequired[int]
    video_files_size_in_mb: NotRequired[int]
    fps: float
    splits: NotRequired[Mapping[str, str]]
    data_path: str
    video_path: NotRequired[str | None]
    features: Mapping[str, Feature]


NUMBERS = ("bool", *(f"{k}int{n}" for k in ("", "u") for n in (8, 16, 32, 64)), "float16", "float32", "float64")
TRUTH = "observation.environment_state"  # name of the simulation's ground truth in older datasets
COUNTED: dict[str, Feature] = {  # counters, which every LeRobotDataset has
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    "frame_index": {"dtype": "int64", "shape": [1], "names": None},
    "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    "index": {"dtype": "int64", "shape": [1], "names": None},
    "task_index": {"dtype": "int64", "shape": [1], "names": None},
}


@dataclass(frozen=True)
class Layout:
    """The content of every frame of a dataset.

    Attributes:
        features: name -> feature, without counters.
        cameras: the nominal cameras.
        parts: names of the parts, which label pictures number from 1.
        fps: frames per second of simulated time.
        task: the task in words.
        robot: name of the robot.
        models: part with labelled poses -> its mesh: vertices (v, 3), m, in the label's frame, and triangles (f, 3).
    """

    features: Mapping[str, Feature]
    cameras: tuple[Camera, ...]
    parts: tuple[str, ...]
    fps: float
    task: str
    robot: str
    models: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @property
    def all(self) -> dict[str, Feature]:
        """All features, including counters."""
        return {**self.features, **COUNTED}


def numbers(names: Sequence[str]) -> Feature:
    """Return the feature of a float32 vector with named entries."""
    return {"dtype": "float32", "shape": [len(names)], "names": list(names)}


def number() -> Feature:
    """Return the feature of a single float32."""
    return {"dtype": "float32", "shape": [1], "names": None}


def flag() -> Feature:
    """Return the feature of a single bool."""
    return {"dtype": "bool", "shape": [1], "names": None}


def picture(camera: Camera) -> Feature:
    """Return the feature of a camera's colour."""
    return {
        "dtype": "image",
        "shape": [camera.height, camera.width, 3],
        "names": ["height", "width", "channels"],
    }


def depth(camera: Camera) -> Feature:
    """Return the feature of a camera's planar depth: float32 in m, 0 for no reading."""
    return {**_grid(camera, "float32"), "info": {"depth_unit": "m"}}


def parts(camera: Camera) -> Feature:
    """Return the feature of a camera's segmentation: the number of the visible part in each pixel."""
    return _grid(camera, "uint8")


def _grid(camera: Camera, dtype: str) -> Feature:
    return {"dtype": dtype, "shape": [camera.height, camera.width], "names": ["height", "width"]}


def colour_of(camera: str) -> str:
    """Return the name of the feature with a camera's colour."""
    return COLOUR + camera


def depth_of(camera: str, features: Container[str]) -> str:
    """Return the name of the feature with a camera's depth.

    Where `features` has only the older of its two names, it is that one.
    """
    old, new = f"observation.images.{camera}_depth", f"observation.depth.{camera}"
    return old if old in features and new not in features else new


def pose_of(part: str, camera: str, features: Container[str]) -> str:
    """Return the name of the feature with a part's pose at the moment shown by a camera's picture.

    Parts that do not move, and parts in older datasets, have one feature for all cameras.
    """
    of_camera = f"label.{part}.{camera}"
    return of_camera if of_camera in features else f"label.{part}"


def truth_of(features: Container[str]) -> str:
    """Return the name of the feature with the simulation's ground truth.

    It is a label, so that LeRobot's policies do not learn from it. Older datasets use LeRobot's name for such an input,
    `observation.environment_state`.
    """
    return TRUTH if TRUTH in features else "label.environment_state"


def short_of(name: str) -> str:
    """Return the short name of a picture feature, for files and messages: CAMERA, CAMERA_depth, parts.CAMERA."""
    if name.startswith("observation.depth."):
        return name.removeprefix("observation.depth.") + "_depth"
    return name.removeprefix(COLOUR).removeprefix("label.")


def is_image(feature: Feature) -> bool:
    """Return whether a feature's values are encoded pictures."""
    return feature.get("dtype") == "image"


def is_picture(feature: Feature) -> bool:
    """Return whether a feature has a value for every pixel, encoded or not."""
    return is_image(feature) or (feature.get("names") == ["height", "width"] and len(feature["shape"]) == 2)


def is_depth(feature: Feature) -> bool:
    """Return whether a feature is a depth picture."""
    info = feature.get("info") or {}
    return bool(info.get("depth_unit") or info.get("is_depth_map"))


def pixel_type(feature: Feature) -> np.dtype:
    """Return the type of a picture's pixels."""
    return np.dtype(np.float32 if is_depth(feature) else np.uint8)


def pixel_shape(feature: Feature) -> tuple[int, ...]:
    """Return the shape of a picture as an array: (H, W, 3), or (H, W) for one channel."""
    height, width, channels = (*feature["shape"], 1)[:3]
    return (height, width) if channels == 1 else (height, width, channels)


def schema(features: Mapping[str, Feature]) -> pa.Schema:
    """Return the Arrow schema of a data file, with metadata for Hugging Face's `datasets` on pictures and arrays."""
    import pyarrow as pa

    fields, types = [], {}
    for name, feature in features.items():
        shape = tuple(feature["shape"])
        if is_image(feature):
            kind, types[name] = pa.struct([("bytes", pa.binary()), ("path", pa.string())]), {"_type": "Image"}
        elif len(shape) == 2:
            kind = pa.list_(pa.list_(pa.type_for_alias(feature["dtype"])))
            types[name] = {"shape": shape, "dtype": feature["dtype"], "_type": "Array2D"}
        else:
            kind, value = pa.type_for_alias(feature["dtype"]), {"dtype": feature["dtype"], "_type": "Value"}
            types[name] = value
            if shape != (1,):
                kind = pa.list_(kind, shape[0])
                types[name] = {"feature": value, "length": shape[0], "_type": "Sequence"}
        fields.append(pa.field(name, kind))
    return pa.schema(fields, {"huggingface": json.dumps({"info": {"features": types}})})


def column(feature: Feature, values: Any) -> pa.Array:
    """Convert T values of a feature, (T, ...) numbers or T encoded pictures, to an Arrow column."""
    import pyarrow as pa

    if is_image(feature):
        pictures = pa.array(values, pa.binary())
        return pa.StructArray.from_arrays([pictures, pa.nulls(len(values), pa.string())], ["bytes", "path"])
    shape = tuple(feature["shape"])
    flat = pa.array(np.asarray(values, feature["dtype"]).reshape(-1))
    if len(shape) == 2:
        rows = pa.ListArray.from_arrays(_ends(len(values) * shape[0], shape[1]), flat)
        return pa.ListArray.from_arrays(_ends(len(values), shape[0]), rows)
    return flat if shape == (1,) else pa.FixedSizeListArray.from_arrays(flat, shape[0])


def _ends(count: int, each: int) -> pa.Array:
    """Return the offsets of `count` lists of `each` entries: 0, each, 2 each and so on."""
    import pyarrow as pa

    return pa.array(np.arange(0, count * each + 1, each, dtype=np.int32))


class Packing(TypedDict):
    """Options of `pyarrow.parquet.ParquetWriter`."""

    compression: str
    use_dictionary: bool
    use_byte_stream_split: list[str]


def packing(features: Mapping[str, Feature]) -> Packing:
    """Return the options of a Parquet file of these features; splitting the bytes of depth halves its zstd size."""
    depths = [name for name, f in features.items() if is_depth(f) and not is_image(f)]
    split = [f"{name}.list.element.list.element" for name in depths]
    return {"compression": "zstd", "use_dictionary": False, "use_byte_stream_split": split}
