"""Camera files: this project's YAML, OpenCV's FileStorage YAML, and ROS's camera_info YAML.

The last two hold intrinsics and lens distortion only. A camera read from them gets the default pose (at the origin of
the base frame, with the base's axes), or that of another camera.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.formats.format import Format, enrol
from vispeg.formats.guard import read_text
from vispeg.formats.yaml_data import parse_yaml
from vispeg.recordings.importers.camera_info import MODELS
from vispeg.render.cameras.camera import FIELDS, Camera

FORMAT = "vispeg-camera/1"
CAMERAS = Format(FORMAT, "a camera file")
Style = Literal["vispeg", "opencv", "ros"]
REQUIRED = FIELDS[:7]  # name, size and pinhole
POSE = FIELDS[-3:]  # parent, pos, quat
# Other programs' files, and what in them is which number here. Their distortion is OpenCV's. The middle of the first
# pixel is at (0, 0) here and in OpenCV, at (0.5, 0.5) in COLMAP.
AS_OURS = f"its numbers in a file with `format: {FORMAT}`"
KALIBR = (
    f"{AS_OURS}: intrinsics are fx, fy, cx, cy, resolution width, height, distortion_coeffs of radtan k1, k2, p1, p2"
)
COLMAP = f"{AS_OURS}: WIDTH, HEIGHT, and of OPENCV fx, fy, cx, cy, k1, k2, p1, p2; less 0.5 for cx and cy"
COLMAP_LINE = re.compile(r"^\d+ [A-Z_]+ \d+ \d+( [-+.\de]+)+\s*$", re.MULTILINE)


def _example(style: Style) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        camera = Camera("eye", 64, 48, 60.0, 61.0, 31.0, 24.0, (0.1, -0.05, 1e-3, 1e-3, 0.0), "flange", (0.0, 0.1, 0.2))
        many = [camera, camera.moved(name="other")] if style == "vispeg" else camera
        return save_cameras(folder / "camera.yaml", many, style=style)

    return write


@enrol("camera_info (ROS)", _example("ros"))
@enrol("FileStorage (OpenCV)", _example("opencv"))
@enrol(FORMAT, _example("vispeg"))
def load_cameras(
    path: str | Path, places: Mapping[str, Camera] | None = None, name: str | None = None
) -> tuple[Camera, ...]:
    """Return all cameras of a file in any of the three formats.

    Args:
        path: the file.
        places: by name, the cameras at whose pose those stand whose pose the file does not state; None for the default
            pose.
        name: of the cameras, in place of that in the file.

    Raises:
        UserError: the file is missing, has none of the formats, or holds impossible values; or neither it nor `places`
            states a camera's pose. The message names the file and, where one is to blame, the key.
    """
    out: list[Camera] = []
    for read, posed in load_posed(path):
        camera = read if name is None else read.moved(name=name)
        if not posed and places is not None:
            if camera.name not in places:
                what = f"does not state where the camera '{camera.name}' is"
                expected = "parent, pos and quat, or a name"
                raise UserError(what, file=path, expected=expected, got=camera.name, choices=places)
            camera = camera.moved(**{key: getattr(places[camera.name], key) for key in POSE})
        out.append(camera)
    return tuple(out)


def load_posed(path: str | Path) -> tuple[tuple[Camera, bool], ...]:
    """Return all cameras of a file, each with whether the file states its pose. Raises UserError as `load_cameras`."""
    text = read_text(path)
    opencv = text.startswith("%YAML:1.0")  # FileStorage writes this line, which only OpenCV's own parser accepts
    if opencv:
        text = text.partition("\n")[2].replace("!!opencv-matrix", "")
    record = parse_yaml(text, path)
    if not isinstance(record, dict):
        raise _unread(text, record, path)
    if opencv or "camera_matrix" in record:
        return ((_from_matrix(record, path), False),)
    if "format" not in record:
        raise _unread(text, record, path)
    content = CAMERAS.open(record, path)
    entries = content["cameras"] if "cameras" in content else [content]
    if not isinstance(entries, list) or not entries:
        raise UserError("not a list of cameras", file=path, key="cameras", got=entries)
    cameras = tuple((from_record(entry, path), any(key in entry for key in POSE)) for entry in entries)
    names = [camera.name for camera, _ in cameras]
    if len(set(names)) < len(names):
        raise UserError("two cameras of one name", file=path, key="cameras", got=names)
    return cameras


def _unread(text: str, record: Any, path: str | Path) -> UserError:
    """Return the error for a file in none of the formats, with a hint for those of Kalibr and COLMAP."""
    each = record.values() if isinstance(record, Mapping) else ()
    if any(isinstance(one, Mapping) and {"camera_model", "intrinsics"} <= one.keys() for one in each):
        return UserError("is a camera chain of Kalibr", file=path, expected=KALIBR)
    if COLMAP_LINE.search(text):
        return UserError("is a list of cameras of COLMAP", file=path, expected=COLMAP)
    return UserError("is not a camera file", file=path, expected=f"'format: {FORMAT}', OpenCV's or ROS's YAML")


def load_camera(path: str | Path, places: Mapping[str, Camera] | None = None, name: str | None = None) -> Camera:
    """Return the only camera of a file, as `load_cameras` does.

    Raises:
        UserError: as `load_cameras` does, and for a file that holds several.
    """
    camera, *others = load_cameras(path, places, name)
    if others:
        raise UserError("holds several cameras", file=path, expected="one", got=[c.name for c in (camera, *others)])
    return camera


def save_cameras(
    path: str | Path, cameras: Camera | Sequence[Camera], *, style: Style = "vispeg", posed: bool = True
) -> Path:
    """Write cameras to a file; `opencv` and `ros` files hold one camera and lose its pose, as does `posed=False`.

    Numbers are written with all digits: reading them back gives the same bits.

    Raises:
        UserError: the file exists, cannot be written, or cannot hold these cameras.
    """
    many = [cameras] if isinstance(cameras, Camera) else list(cameras)
    if not many:
        raise UserError("no camera to save", file=path)
    if style not in ("vispeg", "opencv", "ros"):
        raise UserError("unknown style of camera file", got=style, choices=("vispeg", "opencv", "ros"))
    if style != "vispeg" and len(many) > 1:
        raise UserError(f"a camera file of style '{style}' holds one camera", file=path, got=[c.name for c in many])
    records = [{k: v for k, v in to_record(camera).items() if posed or k not in POSE} for camera in many]
    if style == "vispeg":
        content = {"format": FORMAT, **records[0]} if len(many) == 1 else {"format": FORMAT, "cameras": records}
        text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
    else:
        text = (_ros if style == "ros" else _opencv)(many[0])
    return write_text_atomic(path, text)


def to_record(camera: Camera) -> Mapping[str, object]:
    """Return a camera as plain JSON or YAML values."""
    values = {key: getattr(camera, key) for key in FIELDS}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}


def from_record(record: Any, path: str | Path) -> Camera:
    """Return the camera of a record from `to_record`. Raises UserError, with file and key, for an invalid record."""
    if not isinstance(record, Mapping):
        raise UserError("not a camera", file=path, key="cameras", got=record)
    for key in record:
        if key not in FIELDS:
            raise UserError("unknown key", file=path, key=str(key), got=key, choices=FIELDS)
    if missing := [key for key in REQUIRED if key not in record]:
        raise UserError("is missing", file=path, key=missing[0], expected=", ".join(REQUIRED))
    return _checked(path, dict(record))


def _from_matrix(record: Mapping[str, Any], path: str | Path) -> Camera:
    """Return the camera of an OpenCV or ROS record, whose matrices have the keys rows, cols and data."""
    matrix = _matrix(record, "camera_matrix", path)
    lens = _matrix(record, "distortion_coefficients", path, 0.0)
    model = record.get("distortion_model", "plumb_bob")
    if matrix.size != 9 or abs(matrix[1]) > 1e-9 * abs(matrix[0]):
        raise UserError("not a camera matrix without skew", file=path, key="camera_matrix", got=matrix.tolist())
    fisheye, brown = record.get("fisheye_model"), model in (*MODELS, "none", "")  # OpenCV's and ROS's key
    if fisheye or not brown or np.any(lens[5:]):
        key, got = ("distortion_coefficients", lens.tolist()) if brown else ("distortion_model", model)
        key, got = ("fisheye_model", fisheye) if fisheye else (key, got)
        raise UserError("unknown lens", file=path, key=key, expected="k1, k2, p1, p2, k3 (plumb_bob)", got=got)
    for key in ("image_width", "image_height"):
        if key not in record:
            raise UserError("is missing", file=path, key=key)
    return _checked(
        path,
        {
            "name": str(record.get("camera_name") or Path(path).stem),
            "width": record["image_width"],
            "height": record["image_height"],
            **dict(zip(("fx", "fy", "cx", "cy"), matrix[[0, 4, 2, 5]], strict=True)),
            "distortion": tuple(np.pad(lens[:5], (0, 5 - len(lens[:5])))),
        },
    )


def _checked(path: str | Path, values: Mapping[str, Any]) -> Camera:
    try:
        return Camera(**values)
    except UserError as error:
        raise UserError(str(error), file=path) from error


def _matrix(record: Mapping[str, Any], key: str, path: str | Path, default: float | None = None) -> np.ndarray:
    entry = record.get(key)
    if entry is None and default is not None:
        return np.full(5, default)
    data = entry.get("data") if isinstance(entry, Mapping) else None
    try:
        values = np.asarray(data, float).reshape(-1)
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if not np.isfinite(values).all():
        raise UserError("not a matrix", file=path, key=key, expected="rows, cols and data of finite numbers", got=entry)
    return values


def _opencv(camera: Camera) -> str:
    def matrix(values: np.ndarray) -> str:
        rows, cols = values.shape
        data = ", ".join(map(repr, values.ravel().tolist()))
        return f"!!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]\n"

    return (
        f"%YAML:1.0\n---\ncamera_name: {json.dumps(camera.name)}\n"
        f"image_width: {camera.width}\nimage_height: {camera.height}\n"
        f"camera_matrix: {matrix(camera.K)}distortion_coefficients: {matrix(np.array([camera.distortion]))}"
    )


def _ros(camera: Camera) -> str:
    def matrix(values: np.ndarray) -> Mapping[str, object]:
        return {"rows": values.shape[0], "cols": values.shape[1], "data": values.ravel().tolist()}

    record = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": camera.name,
        "camera_matrix": matrix(camera.K),
        "distortion_model": "plumb_bob",
        "distortion_coefficients": matrix(np.array([camera.distortion])),
        "rectification_matrix": matrix(np.eye(3)),
        "projection_matrix": matrix(np.column_stack([camera.K, np.zeros(3)])),
    }
    return yaml.safe_dump(record, sort_keys=False, default_flow_style=None)
