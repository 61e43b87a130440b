"""A robot that replays a log: `--robot log:FOLDER`, a recording made by `vispeg convert` or a LeRobot folder.

Measurements are replayed on the log's clock, interpolated linearly between samples; the policy's commands have no
effect. This turns a run that another program recorded into a trial. If the log has commands, a note is printed when
they differ from the policy's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.core.paths import expanded
from vispeg.interface.actions import observed
from vispeg.interface.builder import Picture
from vispeg.interface.interface import Interface
from vispeg.interface.observer import Observer
from vispeg.recordings.cell import Outcome, WrenchSensor
from vispeg.recordings.differentiate import CUTOFF_HZ, smooth
from vispeg.recordings.frames.frames import RecordedFrame
from vispeg.recordings.load import HEADER, load
from vispeg.recordings.recording import Recording, in_order
from vispeg.render.cameras.camera import Camera
from vispeg.render.image_kinds import camera_of
from vispeg.trials.driver import Connected, Reading
from vispeg.trials.limits import Limits
from vispeg.trials.loop import Clock, How

OTHER = 2e-3  # m, ten times an arm's repeatability; a larger difference means that another policy made the log
INFO, SPEED = "meta/info.json", ".vel"
FORCE = tuple(f"{what}_{axis}" for what in ("force", "torque") for axis in "xyz")
# convention in LeRobot folders, where only the force lacks the tool's weight; `_dataset_episode` adds it
DATASET_WRENCH = WrenchSensor(frame="base", acts_on="flange")


@dataclass(frozen=True)
class Unlimited(Limits):
    """No limits, because a replay cannot be stopped."""

    def fit(self, interface: Interface, felt: bool) -> None:
        """Raise UserError if the policy observes forces and the log has none."""
        Limits(no_force_limit=not felt).fit(interface, felt)

    def broken(self, interface: Interface, seen: Observer, force: float | None) -> str | None:
        """Return None."""
        return None

    def inside(self, interface: Interface, seen: Observer, tip: np.ndarray) -> bool:
        """Return True."""
        return True


@dataclass(frozen=True, eq=False)
class Episode:
    """The measurements of one episode.

    Attributes:
        name: name shown to the user.
        time: (n,) time since the first sample, s.
        q, dq: (n, nj) joint angles, rad, and velocities, rad/s.
        wrench: (n, 6) force, N, and torque, N m; None without a sensor.
        sensor: convention of the wrench.
        pictures: camera name -> times (m,), s, and a function for each time that reads the picture.
        asked: (n, 3) commanded flange position, m; None if not logged.
        outcome: how the episode ended; None if unknown.
    """

    name: str
    time: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    wrench: np.ndarray | None
    sensor: WrenchSensor
    pictures: Mapping[str, tuple[np.ndarray, Sequence[Callable[[], Picture]]]]
    asked: np.ndarray | None
    outcome: Outcome | None


class LoggedRobot(Clock):
    """Replay a log: a driver, and the clock of the run loop.

    Args:
        folder: a recording, a folder of recordings, or a folder in LeRobot's layout; episodes are replayed in order.

    Raises:
        UserError: there is no recording, or it cannot be read.
    """

    def __init__(self, folder: str | Path):
        place = expanded(folder)
        self._all = _of_dataset(place) if (place / INFO).is_file() else _of_recordings(place)
        self._next, self._now = 0, 0.0
        self._apart = list[float]()  # m, distance of each commanded position from the log's
        self._current: Episode | None = None

    @property
    def episodes(self) -> int:
        """Number of episodes."""
        return len(self._all)

    def check(self, count: int) -> None:
        """Raise UserError if the log has fewer episodes than `count`."""
        if count > self.episodes:
            raise UserError("has no more episodes", key="--episodes", expected=f"{self.episodes} or fewer", got=count)

    def how(self, how: How) -> How:
        """Return run settings fit for a log: without limits and without a rest before the policy acts.

        A note tells that stated limits stop nothing.
        """
        if how.limits != Limits():
            note("a log is replayed: limits of force, speed and reach do not stop it")
        return replace(how, limits=Unlimited(), rest=0.0)

    def now(self) -> float:
        """Return seconds since the episode's first sample."""
        return self._now

    def wait(self, until: float) -> None:
        """Advance to the time `until`, s, without waiting."""
        self._now = max(self._now, until)

    def connect(self, interface: Interface, seed: int) -> Connected:
        """Begin the next episode. Raises UserError: there is none, or it is of another arm."""
        self.check(self._next + 1)
        self._current = self._all[self._next](interface)
        self._next, self._now, self._apart, self._period = self._next + 1, 0.0, [], interface.policy_period_s
        apart, period = float(np.median(np.diff(self._current.time))), interface.controller.period_s
        if apart > 2 * period:
            note(
                f"samples {1e3 * apart:.0f} ms apart are interpolated to {1e3 * period:g} ms in the trials' recordings"
            )
        return Connected(None if self._current.wrench is None else self._current.sensor)

    def read(self, cameras: Sequence[str] = ()) -> Reading:
        """Return the current measurement. Raises EOFError: the episode is over."""
        e = self._episode
        if self._now > e.time[-1] + 1e-9:
            raise EOFError
        pictures = {}
        for name in cameras:
            if name in e.pictures:
                times, readers = e.pictures[name]
                newest = max(0, int(np.searchsorted(times, self._now + 1e-9, side="right")) - 1)
                pictures[name] = readers[newest]()
        wrench = None if e.wrench is None else self._between(e.wrench)
        return Reading(self._now, self._between(e.q), self._between(e.dq), wrench, pictures)

    def command(self, pose: np.ndarray) -> None:
        """Measure the distance of `pose` from the log's command half a policy step later."""
        if (asked := self._episode.asked) is not None:
            at = int(np.searchsorted(self._episode.time, self._now + self._period / 2, side="right")) - 1
            self._apart.append(float(np.linalg.norm(asked[at] - pose[:3])))

    def stop(self) -> Mapping[str, Any] | None:
        """Return the log's outcome, if any; print a note if the log's commands differ from the policy's."""
        apart = float(np.nanmedian(self._apart)) if np.isfinite(self._apart).any() else 0.0
        self._apart = []
        if apart > OTHER:
            note(
                f"{self._episode.name}: the log's commands differ from the policy's by {1e3 * apart:.1f} mm (median): "
                "another policy, another clock or another goal position"
            )
        if self._current is None or self._current.outcome is None:
            return None
        o = self._current.outcome
        verdict: dict[str, Any] = {"success": o.success, "category": "success" if o.success else o.category or "failed"}
        numbers = {"peak_force_n": o.peak_force, "depth_m": o.depth}
        return verdict | {key: value for key, value in numbers.items() if value is not None}

    @property
    def _episode(self) -> Episode:
        assert self._current is not None, "connect comes first"
        return self._current

    def _between(self, values: np.ndarray) -> np.ndarray:
        """Interpolate values (n, k) at the samples; return (k,) at the current time."""
        time = self._episode.time
        at = int(np.clip(np.searchsorted(time, self._now, side="right") - 1, 0, len(time) - 2))
        share = min(1.0, (self._now - time[at]) / (time[at + 1] - time[at]))
        return values[at] + share * (values[at + 1] - values[at])


def _of_recordings(place: Path) -> list[Callable[[Interface], Episode]]:
    """Return a function per episode of the recordings, which reads it. Raises UserError: none, or it cannot be read."""
    inside = sorted(p.parent for p in place.glob(f"*/{HEADER}"))
    found = [load(p) for p in ([place] if (place / HEADER).is_file() or not inside else inside)]
    return [partial(_recorded_episode, rec, int(k)) for rec in found for k in np.unique(_numbers(rec))]


def _recorded_episode(whole: Recording, number: int, interface: Interface) -> Episode:
    """Return an episode of a recording. Raises UserError: another arm, or fewer than two samples of all joints."""
    if set(whole.joints) != set(interface.arm.joints):
        raise UserError("joints of another arm", file=whole.path, expected=interface.arm.joints, got=whole.joints)
    rec = in_order(whole, interface.arm.joints)
    rows = np.flatnonzero((_numbers(rec) == number) & np.isfinite(rec.q).all(1))
    if len(rows) < 2:
        raise UserError("an episode without readings of all joints", file=rec.path, key=f"episode {number}")
    start = rec.time[rows[0]]
    pictures: dict[str, tuple[np.ndarray, list[Callable[[], Picture]]]] = {}
    for key, seen in interface.images.items():
        name = camera_of(key)
        frames = [] if rec.frames is None else [f for f in rec.frames.of(name) if f.episode == number]
        if frames:
            pictures[name] = np.array([f.time - start for f in frames]), _views(frames, seen.eye)
    ended = [o for o in rec.outcomes if o.episode == number]
    return Episode(
        rec.name,
        rec.time[rows] - start,
        rec.q[rows],
        _speeds(rec.time[rows], rec.q[rows], None if rec.dq is None else rec.dq[rows]),
        None if rec.ft is None else _held(rec.ft[rows]),
        rec.wrench or WrenchSensor(),
        pictures,
        None if rec.ee_cmd is None else rec.ee_cmd[rows, :3],
        ended[0] if ended else None,
    )


def _views(frames: Sequence[RecordedFrame], eye: Camera) -> list[Callable[[], Picture]]:
    """Return a function per frame of a camera that reads the newest colour and depth, or else the first to come.

    The pictures' camera has the recording's lens, and the pose of the policy's camera `eye`.
    """
    c = frames[0].camera
    eye = eye.moved(width=c.width, height=c.height, fx=c.fx, fy=c.fy, cx=c.cx, cy=c.cy, distortion=c.distortion)
    rgb = next((f for f in frames if f.rgb_source is not None), None)
    depth = next((f for f in frames if f.depth_source is not None), None)
    out = []
    for f in frames:
        rgb, depth = f if f.rgb_source is not None else rgb, f if f.depth_source is not None else depth
        out.append(lambda rgb=rgb, depth=depth: Picture(rgb and rgb.rgb, depth and depth.depth, eye))
    return out


def _of_dataset(place: Path) -> list[Callable[[Interface], Episode]]:
    """Return a function per episode of more than one frame in a folder in LeRobot's layout, which reads the episode.

    Raises:
        UserError: the folder cannot be read.
    """
    from vispeg.datasets.read import Dataset

    index = Dataset(place, theirs=True)
    successes = index.successes
    return [
        partial(_dataset_episode, index.folder, k, successes)
        for k, row in enumerate(index.episodes)
        if row["length"] > 1
    ]


def _dataset_episode(folder: Path, number: int, successes: Sequence[bool] | None, interface: Interface) -> Episode:
    """Return an episode of a folder in LeRobot's layout. Raises UserError: joints are missing."""
    from vispeg.datasets.layout import colour_of, depth_of
    from vispeg.datasets.read import Dataset

    info = Dataset(folder, theirs=True).info
    places = observed(info["features"])
    joints = interface.arm.joints
    if lacking := [joint for joint in joints if joint not in places]:
        raise UserError("joints are missing", file=folder / INFO, expected=joints, got=lacking, choices=sorted(places))
    eyes: dict[str, dict[str, str]] = {}  # camera -> kind of picture -> feature
    for key in interface.images:
        name = camera_of(key)
        both = {"rgb": colour_of(name), "depth": depth_of(name, info["features"])}
        eyes[name] = {kind: feature for kind, feature in both.items() if feature in info["features"]}
    speeds = tuple(f"{joint}{SPEED}" for joint in joints)
    complete = [group for group in (joints, speeds, FORCE) if all(name in places for name in group)]
    wanted = [name for group in complete for name in group]
    seen = [feature for kinds in eyes.values() for feature in kinds.values()]
    names = dict.fromkeys([*(places[name][0] for name in wanted), *seen])
    chosen = Dataset(folder, names, theirs=True)
    data, believed = chosen.episode(number), chosen.cameras

    def numbers(names: Sequence[str]) -> np.ndarray | None:
        """Return the named numbers (n, len(names)) of the episode; None if the folder lacks one."""
        if any(name not in places for name in names):
            return None
        at = [places[name] for name in names]
        columns = [data[feature].reshape(len(data[feature]), -1)[:, column] for feature, column in at]
        return np.stack(columns, axis=1).astype(float)

    q = numbers(joints)
    assert q is not None
    time = np.arange(len(q)) / float(info["fps"])
    views: dict[str, tuple[np.ndarray, list[Callable[[], Picture]]]] = {}
    for name, kinds in eyes.items():
        if kinds:
            images, eye = {kind: data[feature] for kind, feature in kinds.items()}, believed.get(name)
            views[name] = time, [partial(_picture, images, eye, i) for i in range(len(q))]
    outcome = None
    if successes is not None:
        outcome = Outcome(bool(successes[number]), number, "" if successes[number] else "failed")
    if (wrench := numbers(FORCE)) is not None:
        wrench = _held(wrench)
        wrench[:, :3] += interface.tool.weight_n
    return Episode(
        f"{folder.name}, episode {number}",
        time,
        q,
        _speeds(time, q, numbers(speeds)),
        wrench,
        DATASET_WRENCH,
        views,
        None,
        outcome,
    )


def _picture(images: Mapping[str, np.ndarray], eye: Camera | None, row: int) -> Picture:
    """Return the picture in one row of a camera's images, kind (`rgb`, `depth`) -> rows."""
    return Picture(**{kind: values[row] for kind, values in images.items()}, camera=eye)


def _speeds(time: np.ndarray, q: np.ndarray, dq: np.ndarray | None) -> np.ndarray:
    """Return velocities (n, nj), rad/s: as measured, or else from smoothed angles; 0 where unknown."""
    return np.nan_to_num(smooth(time, q, CUTOFF_HZ)[1] if dq is None else dq)


def _numbers(rec: Recording) -> np.ndarray:
    """Return the episode number of each sample (n,)."""
    return np.zeros(len(rec.time), int) if rec.episode is None else rec.episode


def _held(values: np.ndarray) -> np.ndarray:
    """Return values (n, k) with missing rows replaced by the last finite row; 0 before the first."""
    rows = np.where(np.isfinite(values).all(1), np.arange(len(values)), -1)
    last = np.maximum.accumulate(rows)
    return np.where(last[:, None] >= 0, values[np.maximum(last, 0)], 0.0)
