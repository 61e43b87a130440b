"""The part of an examined recording that the page shows: thinned signals, a still picture, and some frames.

The samples can be freed once this is made, so that only one recording at a time is in memory.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.lines import thinned, thinned_time
from vispeg.diagnosis.pictures.excited import Excitation
from vispeg.recordings.checks.check import CheckReport
from vispeg.recordings.checks.joint_check import smoothed
from vispeg.recordings.checks.plot import MOST_GAPS, cut, laid_out, line_ends
from vispeg.recordings.checks.quality import Limits, saturated
from vispeg.recordings.checks.spikes import without
from vispeg.recordings.checks.timing import Timing
from vispeg.recordings.frames.frames import RecordedFrame
from vispeg.recordings.recording import Recording
from vispeg.render.image_kinds import depth_picture
from vispeg.report.live.traces import MOST, Track
from vispeg.report.record import still
from vispeg.sim.touch import Touch
from vispeg.vision.check import CameraCheck

FRAMES, HEIGHT = 4, 150  # frames shown per camera; largest height of a picture, px
PAPER = 60  # WebP quality of the still picture for print, of 100


@dataclass(frozen=True)
class Frame:
    """A camera frame at a time, s: colour and depth as `data:` links; "" for none."""

    camera: str
    time: float
    colour: str
    depth: str


@dataclass(frozen=True)
class Examined:
    """A recording for the page.

    Attributes:
        name: name of the recording.
        report: findings of `check` on joints and contact.
        cameras: findings on each camera.
        excited: for each camera effect, how much a typical size of it would change the images.
        stated: whether the recording describes the objects in the cell.
        signals: angle, command, speed and torque of the joints; bad readings are a separate array, gaps are bands.
        contact: the wrench over time, with stretches of contact as bands; None without contact data.
        frames: some images of each camera.
        paper: still picture of all joints for print, as a `data:` link.
    """

    name: str
    report: CheckReport
    cameras: tuple[CameraCheck, ...]
    excited: tuple[Excitation, ...]
    stated: bool
    signals: Track
    contact: Track | None
    frames: tuple[Frame, ...]
    paper: str


def examined(
    rec: Recording,
    report: CheckReport,
    limits: Limits | None,
    pictures: tuple[Sequence[CameraCheck], Sequence[Excitation]],
    stated: bool,
    touched: Touch | None,
    drawing: bytes,
) -> Examined:
    """Return the data of a recording that the page shows.

    Args:
        rec: the recording.
        report: findings on joints and contact.
        limits: limits of the joints, if known.
        pictures: findings on the cameras, and how much effects would change their images.
        stated: whether the recording describes the objects in the cell.
        touched: the contact along the recording, if known.
        drawing: the PNG made by `vispeg.recordings.checks.plot`.

    Raises:
        UserError: a damaged picture among the frames.
    """
    return Examined(
        name=rec.name,
        report=report,
        cameras=tuple(pictures[0]),
        excited=tuple(pictures[1]),
        stated=stated,
        signals=_signals(rec, report, limits),
        contact=None if touched is None else _contact(rec, report.timing, touched),
        frames=_frames(rec),
        paper=_lighter(drawing),
    )


def _signals(rec: Recording, report: CheckReport, limits: Limits | None) -> Track:
    """Return the signals of each joint; bad angles are only in `bad`, saturated torques also in `*_clipped`."""
    time, period = laid_out(rec), 1.0 / report.timing.rate_hz
    bad = np.full(rec.q.shape, np.nan)
    good, speed = rec.q.copy(), np.empty(rec.q.shape)
    for j, joint in enumerate(report.joints):
        rows = [spike.row for spike in joint.spikes]
        bad[rows, j] = rec.q[rows, j]
        good[:, j] = without(rec.q[:, j], joint.spikes)
        speed[:, j] = smoothed(rec, j, report.timing, joint.spikes)[1]
    arrays = {"q": good, "speed": speed}
    if np.isfinite(bad).any():
        arrays["bad"] = bad
    if rec.q_cmd is not None:
        arrays |= {"q_cmd": rec.q_cmd, "off": rec.q_cmd - good}
    for name in ("tau", "tau_cmd"):
        values = getattr(rec, name)
        if values is None:
            continue
        arrays[name] = values
        torque_limits = np.full(len(rec.joints), np.inf) if limits is None else limits.torque
        clipped = np.stack(
            [saturated(values[:, j], period, float(torque_limits[j])) for j in range(values.shape[1])], axis=1
        )
        if clipped.any():
            arrays[f"{name}_clipped"] = np.where(clipped, values, np.nan)
    longest = sorted(report.timing.gaps, key=lambda gap: -gap.seconds)[:MOST_GAPS]
    bands = [(float(time[gap.row]), float(time[gap.row + 1])) for gap in longest]
    return _track(rec, report.timing, arrays, bands)


def _contact(rec: Recording, clock: Timing, touched: Touch) -> Track:
    """Return the wrench as read and the contact force, by axis, with stretches of contact as bands."""
    time = laid_out(rec)
    arrays = {
        "force": touched.wrench[:, :3],
        "torque": touched.wrench[:, 3:],
        "contact": touched.contact[:, :3],
    }
    edges = np.flatnonzero(np.diff(np.concatenate([[0], touched.touching.astype(np.int8), [0]])))
    bands = [(float(time[a]), float(time[min(b, len(time) - 1)])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return _track(rec, clock, arrays, sorted(bands, key=lambda band: band[0] - band[1])[:MOST_GAPS])


def _track(rec: Recording, clock: Timing, arrays: dict[str, np.ndarray], bands: Sequence[tuple[float, float]]) -> Track:
    """Return a track of at most MOST samples with the lowest and highest value of every stretch, and gaps."""
    ends = line_ends(rec, clock)
    time = thinned_time(cut(laid_out(rec), ends, between=True), MOST)
    return Track(rec.name, time, {key: thinned(cut(v, ends), MOST) for key, v in arrays.items()}, bands)


def _frames(rec: Recording) -> tuple[Frame, ...]:
    """Return at most FRAMES frames of each camera, evenly spread over the recording."""
    if rec.frames is None:
        return ()
    made = []
    for name in rec.frames.names:
        frames = rec.frames.of(name)
        rows = np.unique(np.linspace(0, len(frames) - 1, min(FRAMES, len(frames))).astype(int))
        depths = [depth for i in rows if (depth := frames[int(i)].depth) is not None]
        readings = np.concatenate([d[d > 0] for d in depths]) if depths else np.zeros(0)
        near, far = np.percentile(readings, [2, 85]).tolist() if len(readings) else (0.0, 1.0)
        made += [_frame(frames[int(i)], near, max(far, near + 1e-3)) for i in rows]
    return tuple(made)


def _frame(frame: RecordedFrame, near: float, far: float) -> Frame:
    """Encode a frame; its depth is coloured from `near` to `far`, m."""
    rgb, depth = frame.rgb, frame.depth
    colour = "" if rgb is None else still(_small(rgb))
    return Frame(
        frame.camera.name,
        frame.time,
        colour,
        "" if depth is None else still(_small(depth_picture(depth, near, far))),
    )


def _small(image: np.ndarray) -> np.ndarray:
    """Return a picture reduced to at most HEIGHT px in height, with its proportions kept."""
    import cv2

    if image.shape[0] <= HEIGHT:
        return image
    width = max(1, round(image.shape[1] * HEIGHT / image.shape[0]))
    return cv2.resize(image, (width, HEIGHT), interpolation=cv2.INTER_AREA)


def _lighter(png: bytes) -> str:
    """Convert a PNG to WebP, about a third of the size; return it as a `data:` link."""
    import cv2

    image = np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR))
    data = cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, PAPER])[1]
    return "data:image/webp;base64," + base64.b64encode(data.tobytes()).decode()
