"""Read pictures from ROS bags: colour and depth, from Image, CompressedImage and CameraInfo messages."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.importers.bagfile import messages, topics_of
from vispeg.recordings.importers.camera_info import described
from vispeg.recordings.importers.pictures import DEPTH_UNIT, Album

IMAGE, COMPRESSED, INFO = (f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo"))
COLOURS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1}  # encoding of colour -> bytes per pixel
BAYER = {"bayer_rggb8": "BG", "bayer_bggr8": "RG", "bayer_gbrg8": "GR", "bayer_grbg8": "GB"}  # ROS' -> OpenCV's name
DEPTHS = {"16UC1": 2, "mono16": 2, "32FC1": 4}  # encoding of depth -> bytes per pixel
FINE = 1e-4  # m, step in which depth that was logged as 32-bit floats is stored
TAILS = (  # last parts of a topic that do not belong to the camera's name
    "compressed",
    "compressedDepth",
    "image_raw",
    "image_rect_raw",
    "image_rect",
    "image_color",
    "image",
)
EVERY = "all"  # request for all topics of pictures
HEAD = 12  # bytes of header before the PNG in a compressedDepth message


def image_topics(reader: Any, wanted: Sequence[str], source: Path) -> dict[str, str]:
    """Return topic -> camera name for the requested topics of pictures; the name is "" where the request states none.

    Args:
        reader: an open bag.
        wanted: entries of the form TOPIC or NAME=TOPIC, or `all`.
        source: the bag, named in error messages.

    Raises:
        UserError: a topic that does not exist or holds no pictures.
    """
    there = sorted({*topics_of(reader, IMAGE), *topics_of(reader, COMPRESSED)})
    if tuple(wanted) == (EVERY,):
        if not there:
            raise UserError("holds no pictures", file=source, key="--images", expected=f"topics of {IMAGE}")
        return dict.fromkeys(there, "")
    out = {}
    for text in wanted:
        name, _, topic = text.rpartition("=")
        if topic not in there:
            raise UserError("no such topic of pictures", file=source, key="--images", got=topic, choices=there)
        out[topic] = name
    return out


def camera_name(topic: str) -> str:
    """Derive a camera's name from its topic: `/wrist/color/image_raw/compressed` -> `wrist_color`."""
    parts = [part for part in topic.split("/") if part]
    while len(parts) > 1 and parts[-1] in TAILS:
        parts.pop()
    return "_".join(parts)


def read_images(
    reader: Any,
    topics: Mapping[str, str],
    album: Album,
    clock: Callable[[float, float], float],
    source: Path,
    known: Mapping[str, RecordedCamera],
) -> dict[str, RecordedCamera]:
    """Read pictures into an album; return camera name -> camera: a known one, or that of its CameraInfo message.

    The cameras have no pose, as CameraInfo has none. Pictures of `image_rect` topics have no distortion. Colour and
    depth of the same optical frame and size are pictures of one camera.

    Args:
        reader: an open bag.
        topics: Image or CompressedImage topic -> camera name; "" to derive the name.
        album: receives the pictures.
        clock: maps (header stamp ns, bag time ns) to s on the clock of the recording's samples.
        source: the bag, named in error messages.
        known: camera name -> camera whose CameraInfo message, if any, is not read.

    Raises:
        UserError: an unknown encoding, a picture that is cut short, a camera that `described` refuses, or two topics
            that would be one camera.
    """
    cameras = dict(known)
    names = _names(reader, topics, source)
    for topic in topics:
        kind, decode = _reading(reader, topic)
        name = names[topic]
        for stamp, at, message in messages(reader, topic, kind, source):
            image, unit = decode(message, source, topic)
            album.add(name, clock(stamp, at), image, unit=unit)
        info = None if name in cameras else _info(reader, topic, source)
        if info is not None:
            rectified = any(part.startswith("image_rect") for part in topic.split("/"))
            cameras[name] = described(name, info, rectified, file=source, key=f"camera '{name}'")
    return cameras


def _reading(reader: Any, topic: str) -> tuple[str, Callable[[Any, Path, str], tuple[np.ndarray, float]]]:
    """Return a topic's message type, and the function that decodes such messages to pictures."""
    return (IMAGE, _raw) if topic in topics_of(reader, IMAGE) else (COMPRESSED, _compressed)


def _names(reader: Any, topics: Mapping[str, str], source: Path) -> dict[str, str]:
    """Return topic -> camera name: the stated name, else one derived from the topic.

    A depth topic without a stated name takes the name of the colour topic with the same frame_id and image size, if
    these have just one topic of each: a driver that aligns depth to the colour camera's pixels stamps it with that
    camera's optical frame.

    Raises:
        UserError: two topics of colour, or two of depth, with one name.
    """
    coloured: dict[str, bool] = {}
    frames: dict[tuple[str, tuple[int, ...]], list[str]] = {}
    for topic in topics:
        kind, decode = _reading(reader, topic)
        message = next((m for _, _, m in messages(reader, topic, kind, source)), None)
        if message is None:
            continue
        image, _ = decode(message, source, topic)
        coloured[topic] = image.ndim == 3
        if message.header.frame_id:
            frames.setdefault((message.header.frame_id, image.shape[:2]), []).append(topic)
    out = {topic: name or camera_name(topic) for topic, name in topics.items()}
    for streams in frames.values():
        colour, depth = ([t for t in streams if coloured[t] is wanted] for wanted in (True, False))
        if len(colour) == len(depth) == 1 and not topics[depth[0]]:
            out[depth[0]] = out[colour[0]]
    first: dict[tuple[str, bool], str] = {}
    for topic, is_colour in coloured.items():
        other = first.setdefault((out[topic], is_colour), topic)
        if other != topic:
            what = f"two topics of pictures would be one camera '{out[topic]}'"
            raise UserError(what, file=source, key="--images", expected="NAME=TOPIC", got=f"{other} and {topic}")
    return out


def _info(reader: Any, topic: str, source: Path) -> Any:
    """Return the first message of the topic `camera_info` beside the image topic; None if there is no such topic."""
    parts = topic.split("/")
    while len(parts) > 1 and parts[-1] in TAILS:
        parts.pop()
    for near in ("/".join([*parts, "camera_info"]), "/".join([*parts[:-1], "camera_info"])):
        if near in topics_of(reader, INFO):
            return next(messages(reader, near, INFO, source))[2]
    return None


def _raw(message: Any, source: Path, topic: str) -> tuple[np.ndarray, float]:
    """Decode an Image message; `topic` is for error messages.

    Returns:
        Colour (H, W, 3) uint8 or depth (H, W) float32 in m, 0 for no reading; and the step, m, in which to store depth.
    """
    import cv2

    encoding, height, width, step = message.encoding, int(message.height), int(message.width), int(message.step)
    channels = COLOURS.get(encoding) or (1 if encoding in BAYER else DEPTHS.get(encoding))
    if channels is None:
        choices = (*COLOURS, *BAYER, *DEPTHS)
        raise UserError(f"{topic}: unknown encoding", file=source, got=encoding, choices=choices)
    data = np.frombuffer(np.ascontiguousarray(message.data).tobytes(), np.uint8)
    if step < width * channels or len(data) < height * step or not height or not width:
        expected = f"{height} rows of {width * channels} bytes or more"
        got = f"{len(data)} bytes, in rows of {step}"
        raise UserError(f"{topic}: a picture is cut short", file=source, expected=expected, got=got)
    rows = data[: height * step].reshape(height, step)[:, : width * channels]
    if encoding in DEPTHS:
        order = ">" if message.is_bigendian else "<"
        kind = np.dtype(np.float32 if encoding == "32FC1" else np.uint16).newbyteorder(order)
        values = np.ascontiguousarray(rows).view(kind).reshape(height, width)
        if encoding == "32FC1":
            return np.nan_to_num(values.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0), FINE
        return values.astype(np.float32) * np.float32(DEPTH_UNIT), DEPTH_UNIT
    if encoding in BAYER:
        return cv2.cvtColor(np.ascontiguousarray(rows), getattr(cv2, f"COLOR_Bayer{BAYER[encoding]}2RGB")), DEPTH_UNIT
    image = rows.reshape(height, width, channels)[..., :3]
    if channels == 1:
        image = np.repeat(image, 3, axis=2)
    elif encoding.startswith("bgr"):
        image = image[..., ::-1]
    return np.ascontiguousarray(image), DEPTH_UNIT


def _compressed(message: Any, source: Path, topic: str) -> tuple[np.ndarray, float]:
    """Decode a CompressedImage message: a JPEG, a PNG, or compressedDepth (a header, then depth as a PNG).

    Arguments and result are as for `_raw`.
    """
    import cv2

    data, form = np.frombuffer(np.ascontiguousarray(message.data).tobytes(), np.uint8), str(message.format)
    has_header = "compressedDepth" in form
    if has_header and not form.startswith("16UC1"):
        expected = "16UC1; compressedDepth png"
        raise UserError(f"{topic}: unknown compression of depth", file=source, expected=expected, got=form)
    flags = cv2.IMREAD_UNCHANGED if has_header or form.startswith(("16UC1", "mono16")) else cv2.IMREAD_COLOR
    try:
        image = cv2.imdecode(data[HEAD:] if has_header else data, flags)
    except cv2.error:
        image = None
    if image is None:
        raise UserError(f"{topic}: a picture is not a JPEG or PNG, or is cut short", file=source, got=form)
    if image.ndim == 2:
        return image.astype(np.float32) * np.float32(DEPTH_UNIT), DEPTH_UNIT
    return np.ascontiguousarray(image[..., ::-1]), DEPTH_UNIT
