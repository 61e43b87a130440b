"""A robot that only plays a log again: `--robot log:FOLDER`, recordings that `vispeg convert` made of bags or folders.

What was measured comes back moment by moment, on a clock of its own that waits for nobody, and what a policy asks for
moves nothing. So a run of the policy that another program recorded becomes a trial. Where the log says what was
commanded, a note says how far the policy asks for something else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.interface.builder import Picture
from vispeg.interface.interface import Interface
from vispeg.interface.observer import Observer
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.frames.frames import Frames
from vispeg.recordings.load import HEADER, load
from vispeg.recordings.recording import Recording, in_order
from vispeg.render.cameras.camera import Camera
from vispeg.trials.driver import Connected, Reading
from vispeg.trials.limits import Limits
from vispeg.trials.loop import Clock, How

CUTOFF_HZ = 15.0  # of velocities that are taken from angles, as where torques are
OTHER = 2e-3  # m: ten times what an arm repeats to; a policy that asks for so much else is not the one that ran


@dataclass(frozen=True)
class Unlimited(Limits):
    """What has been recorded cannot be stopped."""

    def fit(self, interface: Interface, felt: bool) -> None:
        """Raise UserError where the policy is told forces that the log has not."""
        Limits(no_force_limit=not felt).fit(interface, felt)

    def broken(self, interface: Interface, seen: Observer, force: float) -> str | None:
        """Give None."""
        return None

    def inside(self, interface: Interface, seen: Observer, tip: np.ndarray) -> bool:
        """Give True."""
        return True


class LoggedRobot(Clock):
    """Driver and clock at once.

    Args:
        folder: a recording, or a folder of recordings; an episode of theirs after the other.

    Raises:
        UserError: no recording there, or one that cannot be read.
    """

    def __init__(self, folder: str | Path):
        place = Path(folder).expanduser()
        inside = sorted(p.parent for p in place.glob(f"*/{HEADER}"))
        found = [load(p) for p in ([place] if (place / HEADER).is_file() or not inside else inside)]
        self._all = [(rec, int(k)) for rec in found for k in np.unique(_episodes(rec))]
        self._next, self._now, self._apart = 0, 0.0, list[float]()

    @property
    def episodes(self) -> int:
        """How many there are."""
        return len(self._all)

    def how(self, how: How) -> How:
        """Give the way in which a log is played: from its first sample, with no limit."""
        return replace(how, limits=Unlimited(), rest=0.0, silence=np.inf)

    def now(self) -> float:
        """Seconds since the episode's first sample."""
        return self._now

    def wait(self, until: float) -> None:
        """Be there."""
        self._now = max(self._now, until)

    def connect(self, interface: Interface, seed: int) -> Connected:
        """Note that the next episode begins. Raises UserError: there is none, or it is another arm's."""
        if self._next >= self.episodes:
            raise UserError("has no more episodes", key="--episodes", expected=f"{self.episodes} or fewer")
        whole, number = self._all[self._next]
        self._next += 1
        if set(whole.joints) != set(interface.arm.joints):
            raise UserError("joints of another arm", file=whole.path, expected=interface.arm.joints, got=whole.joints)
        rec = in_order(whole, interface.arm.joints)
        rows = np.flatnonzero(_episodes(rec) == number)
        rows = rows[np.isfinite(rec.q[rows]).all(1)]
        if len(rows) < 2:
            raise UserError("an episode without readings of all joints", file=rec.path, key=f"episode {number}")
        start = rec.time[rows[0]]
        self._time, self._q, self._now = rec.time[rows] - start, rec.q[rows], 0.0
        speeds = rec.dq[rows] if rec.dq is not None else smooth(self._time, self._q, CUTOFF_HZ)[1]
        self._dq = np.nan_to_num(speeds)
        self._ft = None if rec.ft is None else _held(rec.ft[rows])
        self._asked = None if rec.ee_cmd is None else rec.ee_cmd[rows]
        self._apart, self._period = [], interface.policy_period_s
        self._pictures = {} if rec.frames is None else _pictures(rec.frames, number, start)
        ended = [o for o in rec.outcomes if o.episode == number]
        self._ended = ended[0] if ended else None
        return Connected(None if rec.ft is None else rec.wrench or WrenchSensor())

    def read(self, cameras: Sequence[str] = ()) -> Reading:
        """Give the last sample by now. Raises EOFError: the episode is over."""
        if self._now > self._time[-1] + 1e-9:
            raise EOFError
        at = self._last(self._time)
        told = {}
        for name in cameras:
            if name in self._pictures:
                times, pictures = self._pictures[name]
                told[name] = pictures[self._last(times)]()
        wrench = None if self._ft is None else self._ft[at]
        return Reading(float(self._time[at]), self._q[at], self._dq[at], wrench, told)

    def command(self, pose: np.ndarray) -> None:
        """Note how far the log's own command is from it, half a policy step later."""
        if self._asked is not None:
            at = int(np.searchsorted(self._time, self._now + self._period / 2, side="right")) - 1
            self._apart.append(float(np.linalg.norm(self._asked[at, :3] - pose[:3])))

    def stop(self) -> Mapping[str, Any] | None:
        """Give how the log says that the episode ended."""
        apart = float(np.nanmedian(self._apart)) if np.isfinite(self._apart).any() else 0.0
        if apart > OTHER:
            note(
                f"{self._all[self._next - 1][0].name}: the log's commands lie {1e3 * apart:.1f} mm (median) from what "
                "the policy asks for: another policy, another clock or another place of the goal"
            )
        self._apart = []
        if self._ended is None:
            return None
        o = self._ended
        said: dict[str, Any] = {"success": o.success, "category": "success" if o.success else o.category or "failed"}
        numbers = {"peak_force_n": o.peak_force, "depth_m": o.depth}
        return said | {key: value for key, value in numbers.items() if value is not None}

    def _last(self, times: np.ndarray) -> int:
        return max(0, int(np.searchsorted(times, self._now + 1e-9, side="right")) - 1)


def _episodes(rec: Recording) -> np.ndarray:
    """(n,) the episode of each sample."""
    return np.zeros(len(rec.time), int) if rec.episode is None else rec.episode


def _held(values: np.ndarray) -> np.ndarray:
    """(n, k) with the last reading in the place of missing ones; 0 before the first."""
    rows = np.where(np.isfinite(values).all(1), np.arange(len(values)), -1)
    last = np.maximum.accumulate(rows)
    return np.where(last[:, None] >= 0, values[np.maximum(last, 0)], 0.0)


def _pictures(frames: Frames, episode: int, start: float) -> dict[str, tuple[np.ndarray, list[Any]]]:
    """Give each camera's times (n,) s and what reads its pictures."""
    out: dict[str, tuple[np.ndarray, list[Any]]] = {}
    for name in frames.names:
        some = [f for f in frames.of(name) if f.episode == episode]
        if some:
            c = some[0].camera  # of which the lens alone counts: the policy's own says where it is
            eye = Camera(name, c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.distortion)
            out[name] = (
                np.array([f.time - start for f in some]),
                [lambda f=f, eye=eye: Picture(f.rgb, f.depth, eye) for f in some],
            )
    return out
