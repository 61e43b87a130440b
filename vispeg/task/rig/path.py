"""A commanded path of the tool's tip: key frames with a pose and a force to exert, put together piece by piece."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vispeg.control.laws import rotated, turned
from vispeg.core.errors import UserError
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import nominal_of
from vispeg.sim.reach import reach
from vispeg.task.rig.posture import posture
from vispeg.task.start import DOWN

Vec = tuple[float, float, float]
FORCE = slice(6, 9)  # columns of a frame's numbers
RAMP = 0.1  # s in which a piece of even speed gets going


@dataclass(frozen=True)
class Frame:
    """Where the tip is asked to be, how the tool is turned, and what it is to exert there.

    Attributes:
        tip: m from the goal's nominal place, base axes.
        turn: rotation vector of the tool from straight down, rad, base axes.
        yaw: turn of the flange about the vertical before that, rad.
        force: N, base axes, that the tip is to exert on what it meets: the spring of the controller is wound up by it.
        pivot: height above the tip of the point that turns leave where it is, m.
    """

    tip: Vec
    turn: Vec = (0.0, 0.0, 0.0)
    force: Vec = (0.0, 0.0, 0.0)
    pivot: float = 0.0
    yaw: float = 0.0


@dataclass(frozen=True)
class Leg:
    """How a frame is reached from the one before: in `seconds`, at rest at both ends (`smooth`) or at one speed."""

    frame: Frame
    seconds: float
    kind: Literal["smooth", "even"] = "smooth"


class Path:
    """Legs one after another, beginning at rest in `start`."""

    def __init__(self, start: Frame):
        self.start, self.legs = start, list[Leg]()

    @property
    def last(self) -> Frame:
        """Where the path ends so far."""
        return self.legs[-1].frame if self.legs else self.start

    def to(self, seconds: float, kind: Literal["smooth", "even"] = "smooth", **changes) -> Path:
        """Goes on to the last frame with these changes; without any it waits."""
        self.legs.append(Leg(replace(self.last, **changes), seconds, kind))
        return self

    def frames(self, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
        """Time (n,) s and numbers (n, 11) of the frame at each tick: tip, turn, force, pivot, yaw."""
        ends = np.cumsum([0.0, *(leg.seconds for leg in self.legs)])
        time = np.arange(int(round(ends[-1] * rate_hz)) + 1) / rate_hz
        out = np.tile(_numbers(self.start), (len(time), 1))
        before = _numbers(self.start)
        for leg, begin, end in zip(self.legs, ends[:-1], ends[1:], strict=True):
            rows = time >= begin - 1e-9
            share = _share(leg.kind, np.clip((time[rows] - begin) / (end - begin), 0.0, 1.0), end - begin)
            after = _numbers(leg.frame)
            out[rows] = before + share[:, None] * (after - before)
            before = after
        return time, out


def commands(
    frames: np.ndarray, scene: Scene, stiffness: tuple[float, float], near: np.ndarray | None = None
) -> np.ndarray:
    """Flange poses (n, 7) m and w x y z to command, so that the controller exerts what the frames ask for.

    An operational space controller holds the flange by a spring: a pose error `e` gives the wrench `Lambda K e`. The
    error that gives a force at the tip is `K^-1 Lambda^-1 (f, r x f)`, with Lambda of the nominal arm over the goal and
    r from the flange to the tip.

    Args:
        frames: (n, 11) numbers of `Frame`.
        scene: the believed cell.
        stiffness: of the controller, 1/s^2, for translation and rotation.
        near: (nj,) rad, the posture in which the arm does it; the cell's where none is stated.

    Raises:
        UserError: a pose out of the arm's reach.
    """
    tip, turn, force, pivot = frames[:, :3], frames[:, 3:6], frames[:, FORCE], frames[:, 9:10]
    rot = turned(facing(frames[:, 10]), turn)
    up = np.zeros((len(frames), 3))
    up[:, 2:] = scene.tip - pivot
    still = np.array([0.0, 0.0, 1.0]) * pivot  # of the tool's part below the pivot, straight
    pos = np.array(scene.target) + tip + still - rotated(rot, up)
    lever = np.cross(rotated(rot, np.array([0.0, 0.0, scene.tip])), force)
    q = posture(scene) if near is None else near
    error = np.concatenate([force, lever], axis=1) @ _softness(scene, stiffness, q).T
    pos = pos + error[:, :3]
    rot = turned(rot, error[:, 3:])
    _check(scene, pos, rot, q)
    return np.concatenate([pos, rot], axis=1)


def facing(yaw: np.ndarray) -> np.ndarray:
    """Flange orientation (n, 4) w x y z straight down, turned by yaw (n,) rad about the vertical."""
    vertical = np.zeros((len(yaw), 3))
    vertical[:, 2] = yaw
    return turned(np.tile(DOWN, (len(yaw), 1)), vertical)


def quarter(scene: Scene) -> float:
    """Give a quarter turn of the flange over the goal, to the side that leaves the last joints more room, rad."""
    nominal, at = nominal_of(scene.nominal, 1), np.array(scene.target) + [0, 0, 0.03 + scene.tip]
    margins = []
    for yaw in (np.pi / 2, -np.pi / 2):
        q, error = reach(nominal, at[None], facing(np.array([yaw])), posture(scene)[None])
        room = np.minimum(q[0] - scene.range[:, 0], scene.range[:, 1] - q[0]).min()
        margins.append((float(room) if error[0] < 1e-4 else -1.0, yaw))
    return max(margins)[1]


def _softness(scene: Scene, stiffness: tuple[float, float], q: np.ndarray) -> np.ndarray:
    """(6, 6) pose error a wrench at the flange, straight over the goal in the posture q (nj,) rad."""
    mass, jac, *_ = nominal_of(scene.nominal, 1).operational(q[None])
    inverse = (jac @ np.linalg.solve(mass, np.swapaxes(jac, 1, 2)))[0]
    return inverse / np.repeat(stiffness, 3)[:, None]


def _check(scene: Scene, pos: np.ndarray, rot: np.ndarray, near: np.ndarray, count: int = 64) -> None:
    """Look at some of the poses. Raises UserError for one that the arm cannot take."""
    some = np.unique(np.linspace(0, len(pos) - 1, count).astype(int))
    nominal = nominal_of(scene.nominal, len(some))
    q, error = reach(nominal, pos[some], rot[some], np.tile(near, (len(some), 1)))
    low, high = scene.range.T
    bad = (error > 1e-3) | (q < low).any(axis=1) | (q > high).any(axis=1)
    if bad.any():
        at = pos[some[int(bad.argmax())]].round(3).tolist()
        raise UserError(
            "the motion leaves the arm's reach", key="--motion", expected="a fixture nearer the base", got=at
        )


def _numbers(frame: Frame) -> np.ndarray:
    return np.array([*frame.tip, *frame.turn, *frame.force, frame.pivot, frame.yaw])


def _share(kind: str, u: np.ndarray, seconds: float) -> np.ndarray:
    """How much of a leg is done at its share u of time."""
    if kind == "smooth":
        return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    ramp = min(RAMP / seconds, 0.5)
    return np.where(u < ramp, 0.5 * u**2 / ramp, u - 0.5 * ramp) / (1.0 - 0.5 * ramp)
