"""A commanded path of the tool's tip, built from key frames with a pose and a force to exert."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vispeg.control.laws import rotated, turned
from vispeg.core.errors import UserError
from vispeg.interface.observer import DOWN
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import nominal_of
from vispeg.sim.reach import reach
from vispeg.task.rig.posture import posture

Vec = tuple[float, float, float]
FORCE = slice(6, 9)  # columns of the force in a frame's numbers
RAMP = 0.1  # s, duration of the acceleration and of the deceleration in a leg of even speed


@dataclass(frozen=True)
class Frame:
    """A commanded pose of the tool with a force to exert.

    Attributes:
        tip: position of the tip from the goal's nominal place, m, base axes.
        turn: rotation vector of the tool from straight down, rad, base axes.
        force: force that the tip exerts if it is in contact, N, base axes: the controller's spring is stretched by it.
        pivot: height above the tip, along the tool, of the point about which `turn` rotates, m.
        yaw: rotation of the flange about the vertical before `turn`, rad.
    """

    tip: Vec
    turn: Vec = (0.0, 0.0, 0.0)
    force: Vec = (0.0, 0.0, 0.0)
    pivot: float = 0.0
    yaw: float = 0.0


@dataclass(frozen=True)
class Leg:
    """A transition from the previous frame to `frame`, which takes `seconds`.

    `smooth` follows a minimum-jerk profile; `even` keeps a constant speed except for short ramps (`RAMP`).
    """

    frame: Frame
    seconds: float
    kind: Literal["smooth", "even"] = "smooth"


class Path:
    """A sequence of legs, which begins at rest in `start`."""

    def __init__(self, start: Frame):
        self.start, self.legs = start, list[Leg]()

    @property
    def last(self) -> Frame:
        """The frame in which the path ends so far."""
        return self.legs[-1].frame if self.legs else self.start

    def to(self, seconds: float, kind: Literal["smooth", "even"] = "smooth", **changes) -> Path:
        """Append a leg to the last frame with these changes, and return the path; without changes the leg waits."""
        self.legs.append(Leg(replace(self.last, **changes), seconds, kind))
        return self

    def frames(self, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
        """Return time (n,) s and the frame's numbers (n, 11) at each tick: tip, turn, force, pivot, yaw."""
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
    """Return the flange poses (n, 7), m and w x y z, with which the controller exerts the frames' forces.

    An operational space controller holds the flange by a spring: a pose error `e` gives the wrench `Lambda K e`. The
    error that gives a force f at the tip is `K^-1 Lambda^-1 (f, r x f)`, with Lambda of the nominal arm over the goal
    and r from the flange to the tip.

    Args:
        frames: (n, 11) numbers of `Frame`, see `Path.frames`.
        scene: the believed cell.
        stiffness: of the controller, 1/s^2, for translation and rotation.
        near: (nj,) rad, the arm's posture during the motion; None for the cell's.

    Raises:
        UserError: a pose out of the arm's reach.
    """
    tip, turn, force, pivot = frames[:, :3], frames[:, 3:6], frames[:, FORCE], frames[:, 9:10]
    rot = turned(facing(frames[:, 10]), turn)
    to_pivot = np.zeros((len(frames), 3))  # from the flange, in its axes
    to_pivot[:, 2:] = scene.tip - pivot
    still = np.array([0.0, 0.0, 1.0]) * pivot  # from the tip up to the pivot, before the tool turns
    pos = np.array(scene.target) + tip + still - rotated(rot, to_pivot)
    lever = np.cross(rotated(rot, np.array([0.0, 0.0, scene.tip])), force)
    q = posture(scene) if near is None else near
    error = np.concatenate([force, lever], axis=1) @ _softness(scene, stiffness, q).T
    pos = pos + error[:, :3]
    rot = turned(rot, error[:, 3:])
    _check(scene, pos, rot, q)
    return np.concatenate([pos, rot], axis=1)


def facing(yaw: np.ndarray) -> np.ndarray:
    """Return flange orientations (n, 4) w x y z: straight down, turned by yaw (n,) rad about the vertical."""
    vertical = np.zeros((len(yaw), 3))
    vertical[:, 2] = yaw
    return turned(np.tile(DOWN, (len(yaw), 1)), vertical)


def quarter(scene: Scene) -> float:
    """Return +-pi/2 rad: the quarter turn of the flange over the goal that leaves the joints the larger margin."""
    nominal, at = nominal_of(scene.nominal, 1), np.array(scene.target) + [0, 0, 0.03 + scene.tip]
    margins = []
    for yaw in (np.pi / 2, -np.pi / 2):
        q, error = reach(nominal, at[None], facing(np.array([yaw])), posture(scene)[None])
        room = np.minimum(q[0] - scene.range[:, 0], scene.range[:, 1] - q[0]).min()
        margins.append((float(room) if error[0] < 1e-4 else -1.0, yaw))
    return max(margins)[1]


def _softness(scene: Scene, stiffness: tuple[float, float], q: np.ndarray) -> np.ndarray:
    """Return the controller's compliance (6, 6) at the posture q (nj,) rad: pose error of the flange per wrench."""
    mass, jac, *_ = nominal_of(scene.nominal, 1).operational(q[None])
    inverse = (jac @ np.linalg.solve(mass, np.swapaxes(jac, 1, 2)))[0]
    return inverse / np.repeat(stiffness, 3)[:, None]


def _check(scene: Scene, pos: np.ndarray, rot: np.ndarray, near: np.ndarray, count: int = 64) -> None:
    """Check `count` of the poses, evenly spread. Raises UserError for one out of the arm's reach."""
    rows = np.unique(np.linspace(0, len(pos) - 1, count).astype(int))
    nominal = nominal_of(scene.nominal, len(rows))
    q, error = reach(nominal, pos[rows], rot[rows], np.tile(near, (len(rows), 1)))
    low, high = scene.range.T
    bad = (error > 1e-3) | (q < low).any(axis=1) | (q > high).any(axis=1)
    if bad.any():
        at = pos[rows[int(bad.argmax())]].round(3).tolist()
        raise UserError(
            "the motion leaves the arm's reach", key="--motion", expected="a fixture nearer the base", got=at
        )


def _numbers(frame: Frame) -> np.ndarray:
    return np.array([*frame.tip, *frame.turn, *frame.force, frame.pivot, frame.yaw])


def _share(kind: str, u: np.ndarray, seconds: float) -> np.ndarray:
    """Return the share of a leg's path that is done at the share u (n,) of its time."""
    if kind == "smooth":
        return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    ramp = min(RAMP / seconds, 0.5)
    return np.where(u < ramp, 0.5 * u**2 / ramp, u - 0.5 * ramp) / (1.0 - 0.5 * ramp)
