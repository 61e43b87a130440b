"""What a dataset holds: its features as LeRobotDataset v3.0 names them, its cameras, its rate.

The format is LeRobot's own, see docs/datasets.md. A feature is a mapping with `dtype`, `shape` and `names`; images are
`dtype: image`, depth among them has `info: {is_depth_map: true, depth_unit: m}`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.render.camera import Camera

if TYPE_CHECKING:
    import pyarrow as pa

VERSION = "v3.0"
Feature = Mapping[str, Any]
COUNTED: dict[str, Feature] = {  # what every LeRobotDataset has beside its own
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    "frame_index": {"dtype": "int64", "shape": [1], "names": None},
    "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    "index": {"dtype": "int64", "shape": [1], "names": None},
    "task_index": {"dtype": "int64", "shape": [1], "names": None},
}


@dataclass(frozen=True)
class Layout:
    """What every frame of a dataset holds.

    Attributes:
        features: by name, without those that are only counted.
        cameras: as their user believes them.
        parts: names of the parts that label pictures count from 1.
        fps: frames a second of simulated time.
        task: in words.
        robot: its name.
    """

    features: Mapping[str, Feature]
    cameras: tuple[Camera, ...]
    parts: tuple[str, ...]
    fps: float
    task: str
    robot: str

    @property
    def all(self) -> dict[str, Feature]:
        """Every feature, those that are only counted too."""
        return {**self.features, **COUNTED}


def numbers(names: Sequence[str]) -> Feature:
    """A float32 vector with a name for each entry."""
    return {"dtype": "float32", "shape": [len(names)], "names": list(names)}


def number() -> Feature:
    """One float32."""
    return {"dtype": "float32", "shape": [1], "names": None}


def flag() -> Feature:
    """One bool."""
    return {"dtype": "bool", "shape": [1], "names": None}


def picture(camera: Camera, channels: int, depth: bool = False) -> Feature:
    """A camera's picture; depth is float32 in m, 0 where there is no reading."""
    shape = {
        "dtype": "image",
        "shape": [camera.height, camera.width, channels],
        "names": ["height", "width", "channels"],
    }
    return shape | ({"info": {"is_depth_map": True, "depth_unit": "m"}} if depth else {})


def is_image(feature: Feature) -> bool:
    """Whether a feature is a picture."""
    return feature.get("dtype") == "image"


def is_depth(feature: Feature) -> bool:
    """Whether a feature is a depth picture."""
    return bool((feature.get("info") or {}).get("is_depth_map"))


def pixel_type(feature: Feature) -> np.dtype:
    """The type of a picture's pixels."""
    return np.dtype(np.float32 if is_depth(feature) else np.uint8)


def pixel_shape(feature: Feature) -> tuple[int, ...]:
    """The shape of a picture as NumPy holds it: (H, W, 3), or (H, W) for one channel."""
    height, width, channels = feature["shape"]
    return (height, width) if channels == 1 else (height, width, channels)


def schema(features: Mapping[str, Feature]) -> pa.Schema:
    """The Arrow schema of a data file, with the note by which Hugging Face's `datasets` knows pictures again."""
    import pyarrow as pa

    fields, known = [], {}
    for name, feature in features.items():
        width = 1 if is_image(feature) else int(np.prod(feature["shape"]))
        if is_image(feature):
            kind, known[name] = pa.struct([("bytes", pa.binary()), ("path", pa.string())]), {"_type": "Image"}
        else:
            scalar = pa.type_for_alias(feature["dtype"])
            value = {"dtype": feature["dtype"], "_type": "Value"}
            kind = scalar if width == 1 else pa.list_(scalar, width)
            known[name] = value if width == 1 else {"feature": value, "length": width, "_type": "Sequence"}
        fields.append(pa.field(name, kind))
    return pa.schema(fields, {"huggingface": json.dumps({"info": {"features": known}})})


def column(feature: Feature, values: Any) -> pa.Array:
    """T values of a feature as a column: (T, ...) numbers, or T encoded pictures."""
    import pyarrow as pa

    if is_image(feature):
        fields = [pa.array(list(values), pa.binary()), pa.nulls(len(values), pa.string())]
        return pa.StructArray.from_arrays(fields, ["bytes", "path"])
    width, kind = int(np.prod(feature["shape"])), pa.type_for_alias(feature["dtype"])
    flat = pa.array(np.asarray(values, feature["dtype"]).reshape(-1), kind)
    return flat if width == 1 else pa.FixedSizeListArray.from_arrays(flat, width)
