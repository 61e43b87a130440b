"""Check a recording's frames before anything is fitted to them: clock, light, sharpness, depth, views."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vispeg.core.counts import count
from vispeg.core.robust import spread
from vispeg.recordings.cell import OPEN_CELL
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.frames.joints import joints_at
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.vision.blur import softness
from vispeg.vision.borders import Borders, borders_of
from vispeg.vision.eye import camera_of
from vispeg.vision.photometry import SATURATED
from vispeg.vision.precision import Precision, View, precisions
from vispeg.vision.predict import Predictor
from vispeg.vision.search import search
from vispeg.worlds.world import World

CELLS = (8, 6)  # of an image, for its coverage
FEW = 3  # border points that a cell needs to be covered
LOST = 1.5  # median periods without a frame from which one was lost
MOST = 60  # frames of a camera that are drawn: coverage needs no more
SLOPE = 5e-3  # s before and after a frame, between which speeds are measured


@dataclass(frozen=True)
class CameraCheck:
    """Figures of the frames of one camera; None if unknown.

    Attributes:
        camera, frames: its name, how many.
        mount: what carries it, `base` or `flange`; None where that is not stated.
        rate_hz: frames a second, from the median period.
        lost, repeated: number of frames missing between time stamps, and of frames equal to the one before.
        jitter_s: robust standard deviation of the periods.
        dark, saturated: share of the pixels at the ends of the range.
        brightness, drift: median over the frames of their median grey levels, and the range of these.
        softness: px, median blur of the borders.
        fill_rate: % of the pixels with depth.
        near, far: m, 5 and 95 % quantiles of the depth readings.
        coverage: share of the image's cells with enough border points.
        distance: m, 5 and 95 % quantiles for borders that the hand does not carry; their ratio tells scale from bias.
        tilt, roll: degrees between the two most different views, of the optical axis and about it.
        speed: m/s and rad/s, the greatest of the camera relative to the cell.
        precision: how well each number of the camera's errors would be known.
    """

    camera: str
    frames: int
    mount: str | None
    rate_hz: float
    lost: int
    repeated: int
    jitter_s: float
    dark: float | None = None
    saturated: float | None = None
    brightness: float | None = None
    drift: float | None = None
    softness: float | None = None
    fill_rate: float | None = None
    near: float | None = None
    far: float | None = None
    coverage: float | None = None
    distance: tuple[float, float] | None = None
    tilt: float | None = None
    roll: float | None = None
    speed: tuple[float, float] | None = None
    precision: tuple[Precision, ...] = ()

    def to_json(self) -> Mapping[str, object]:
        """Return the figures as plain data."""
        return asdict(self)


def check_frames(
    rec: Recording, scene: Scene | None, progress: Callable[[float], None] = lambda share: None
) -> list[CameraCheck]:
    """Examine the frames of a recording, camera by camera.

    Args:
        rec: with frames.
        scene: the cell with the recording's cameras; None if it is not stated, and then views are not checked.
        progress: called with the share that is done.

    Raises:
        UserError: a damaged picture.
    """
    frames = rec.frames
    out: list[CameraCheck] = []
    for number, name in enumerate(frames.names if frames is not None else ()):
        mine = frames.of(name) if frames is not None else None
        if mine is None:
            continue
        looked = _thinned(mine)
        values = {**_clock(mine), **_light(looked), **_depth(looked)}
        if scene is not None and frames is not None and frames.cameras[name].pose is not None:
            values |= _views(rec, looked, scene)
        out.append(CameraCheck(name, len(mine), mine[0].camera.mount, **values))
        progress((number + 1) / len(frames.names if frames is not None else ()))
    return out


def _thinned(frames: Frames) -> Frames:
    """Return at most `MOST` of the frames, evenly spaced."""
    return frames.some(np.unique(np.linspace(0, len(frames) - 1, min(MOST, len(frames))).astype(int)))


def _clock(frames: Frames) -> Mapping[str, Any]:
    """Return the figures of the time stamps, and the number of repeated frames."""
    times, episodes = frames.times, frames.episodes
    steps = np.diff(times)[np.diff(episodes) == 0]
    period = float(np.median(steps)) if len(steps) else 0.0
    lost = int(np.sum(np.rint(steps[steps > LOST * period] / period) - 1)) if period > 0 else 0
    jitter = spread(steps) if len(steps) else 0.0
    repeated, before = 0, None
    for frame in frames:
        now = frame.rgb if frame.rgb_source is not None else frame.depth
        repeated += int(before is not None and now is not None and np.array_equal(before, now))
        before = now
    return {"rate_hz": 1 / period if period > 0 else 0.0, "lost": lost, "repeated": repeated, "jitter_s": jitter}


def _light(frames: Frames) -> Mapping[str, Any]:
    """Return the figures of grey levels; empty without colour."""
    pictures = [rgb for frame in frames if (rgb := frame.rgb) is not None]
    if not pictures:
        return {}
    levels = [float(np.median(rgb)) for rgb in pictures]
    return {
        "dark": float(np.mean([np.mean(rgb.max(axis=2) <= SATURATED[0]) for rgb in pictures])),
        "saturated": float(np.mean([np.mean(rgb.max(axis=2) >= SATURATED[1]) for rgb in pictures])),
        "brightness": float(np.median(levels)),
        "drift": max(levels) - min(levels),
    }


def _depth(frames: Frames) -> Mapping[str, Any]:
    """Return the figures of depth; empty without depth."""
    depths = [depth for frame in frames if (depth := frame.depth) is not None]
    if not depths:
        return {}
    readings = np.concatenate([depth[depth > 0][::11] for depth in depths])  # every 11th is enough
    fill = 100.0 * float(np.mean([np.mean(depth > 0) for depth in depths]))
    low, high = np.quantile(readings, [0.05, 0.95]).tolist() if len(readings) else (None, None)
    return {"fill_rate": fill, "near": low, "far": high}


def _views(rec: Recording, frames: Frames, scene: Scene) -> Mapping[str, Any]:
    """Return the figures of the views of one camera, from the borders that the nominal cell has in them."""
    name, camera = frames[0].camera.name, camera_of(frames[0].camera)
    q = joints_at(rec, frames.times, frames.episodes)
    around = [joints_at(rec, frames.times + k * SLOPE, frames.episodes) for k in (-1, 1)]
    dq = np.nan_to_num((around[1] - around[0]) / (2 * SLOPE))
    views, poses, soft = [], [], []
    with Predictor(scene, [camera]) as predictor:
        predictor.see(World())
        for i in np.flatnonzero(np.isfinite(q).all(axis=1)):
            borders = borders_of(predictor.draw(name, q[i]), predictor.geometry)
            poses.append(predictor.geometry.pose(name))
            views.append(View(borders, q[i], dq[i]))
            soft.append(_soft(frames[int(i)], borders))
        if not any(len(view.borders) for view in views):
            return {"coverage": 0.0} if views else {}
        precision = precisions(predictor.geometry, name, views)
        speed = _speed(predictor, name, views)
    parts = list(scene.parts)
    carried = [1 + parts.index(part) for part in ("gripper", scene.held) if part in parts]
    depth = np.concatenate([v.borders.depth[~np.isin(v.borders.parts[:, 0], carried)] for v in views])
    sharp = np.concatenate(soft)
    tilt, roll = _spread(poses)
    return {
        "softness": float(np.nanmedian(sharp)) if np.isfinite(sharp).any() else None,
        "coverage": _coverage(views, camera.width, camera.height),
        "distance": (float(np.quantile(depth, 0.05)), float(np.quantile(depth, 0.95))) if len(depth) else None,
        "tilt": tilt,
        "roll": roll,
        "speed": speed,
        "precision": tuple(precision),
    }


def _soft(frame: RecordedFrame, borders: Borders) -> np.ndarray:
    """Return the blur (n,) px of the borders in a frame; one NaN without colour."""
    rgb = frame.rgb
    return np.full(1, np.nan) if rgb is None else softness(rgb, borders, search(rgb, borders))


def _coverage(views: Sequence[View], width: int, height: int) -> float:
    """Return the share of the image's cells with `FEW` border points or more in all views together."""
    pixel = np.concatenate([view.borders.pixel for view in views])
    count = np.histogram2d(*pixel.T, bins=CELLS, range=[[-0.5, width - 0.5], [-0.5, height - 0.5]])[0]
    return float(np.mean(count >= FEW))


def _spread(poses: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """Return the widest angle between two optical axes, and the range of turns about the mean view's axis, degrees."""
    axes = np.stack([turn for _, turn in poses])
    forward = axes[:, :, 2]
    tilt = float(np.degrees(np.arccos(np.clip(forward @ forward.T, -1, 1)).max()))
    u, _, v = np.linalg.svd(axes.mean(axis=0))
    away = np.einsum("ji,njk->nik", u @ v, axes)
    roll = np.degrees(np.arctan2(away[:, 1, 0], away[:, 0, 0]))
    return tilt, float(roll.max() - roll.min())


def _speed(predictor: Predictor, name: str, views: Sequence[View]) -> tuple[float, float]:
    """Return the greatest speed of a camera in the views, m/s and rad/s."""
    linear, angular = [], []
    geometry = predictor.geometry
    for view in views:
        ends = []
        for sign in (-1, 1):
            geometry.at(view.q + sign * SLOPE * view.dq)
            pos, turn = geometry.pose(name)
            ends.append((pos.copy(), turn.copy()))
        linear.append(np.linalg.norm(ends[1][0] - ends[0][0]) / (2 * SLOPE))
        cosine = (np.trace(ends[0][1].T @ ends[1][1]) - 1) / 2
        angular.append(np.arccos(np.clip(cosine, -1, 1)) / (2 * SLOPE))
    return float(max(linear)), float(max(angular))


def warnings_of(check: CameraCheck) -> list[str]:
    """Return sentences on what would mislead a comparison, and on what these frames cannot tell."""
    name, out = check.camera, []
    if check.lost:
        out.append(f"{name}: {count(check.lost, 'frame')} lost between stamps")
    if check.repeated:
        why = "delivered again, or nothing moves in sight"
        out.append(f"{name}: {count(check.repeated, 'frame')} the same as the one before: {why}")
    if check.rate_hz and check.jitter_s * check.rate_hz > 0.1:
        out.append(f"{name}: the period jitters by {1e3 * check.jitter_s:.3g} ms: are these times of arrival?")
    if check.saturated is not None and check.saturated > 0.1:
        out.append(f"{name}: {check.saturated:.0%} of the pixels are saturated: expose less")
    if check.dark is not None and check.dark > 0.3:
        out.append(f"{name}: {check.dark:.0%} of the pixels are black: expose more")
    if check.softness is not None and check.softness > 2:
        out.append(f"{name}: borders are blurred by {check.softness:.1f} px: focus, expose shorter, or move slower")
    if check.fill_rate is not None and check.fill_rate < 70:
        out.append(f"{name}: {100 - check.fill_rate:.0f} % of the depth has no reading")
    if check.coverage == 0:
        out.append(f"{name}: shows no border of the cell from where it is stated to be: is its pose as stated?")
    elif check.coverage is not None and check.coverage < 0.5:
        out.append(f"{name}: borders come by {check.coverage:.0%} of the image: nothing is told of the lens elsewhere")
    if check.distance is not None and check.near is not None and check.distance[1] < 1.5 * check.distance[0]:
        out.append(f"{name}: distances differ by less than 1.5 times: scale and bias of depth look the same")
    unknown = [t for t in check.precision if not t.determined]
    if unknown:
        numbers = ", ".join(f"{t.effect}.{t.parameter} ({t.sigma:.2g} {t.unit})" for t in unknown)
        out.append(f"{name}: cannot tell {numbers}: {_advice(unknown, check.mount)}")
    return out


def _advice(unknown: Sequence[Precision], mount: str | None) -> str:
    """Return the motion that would determine the unknown parameters of a camera on `mount`."""
    names = {t.effect for t in unknown}
    if mount == "base":
        return "bring the hand near it and to the image's edges, or hold a board before it (vispeg camera calibrate)"
    advice = []
    if "camera_delay" in names:
        advice.append("sideways and back (look-sideways)")
    if "rolling_shutter" in names:
        advice.append("fast along the image's columns (look-fast)")
    if names & {"focal_error", "camera_offset", "principal_point_error"}:
        advice.append("with tilt and roll (look-tilt, look-roll)")
    if "lens_distortion" in names:
        advice.append("so that borders of parts come near the image's edges")
    all_of_it = "look-fast" if names == {"rolling_shutter"} else "look"
    return f"move it {', '.join(advice)}; `vispeg record {OPEN_CELL} --motion {all_of_it}` has all of it"
