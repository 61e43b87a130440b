"""Excitation: commanded motions that make missing effects visible.

Every motion starts at rest at its centre posture, stays within a share of the position and velocity limits, and
includes the exact time derivative of its positions. There is one small function per motion, looked up by name. It gets
a `Room`, the bounds, and returns angles and speeds (n, nj).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.validate import check_length

SEVEN_AXIS_CENTRE = (0.0, 0.5, 0.0, -1.2, 0.0, 0.9, 0.0)  # flange in front, pointing down, well above the table
SEVEN_AXIS_REACH = (0.9, 0.4, 0.7, 0.45, 1.0, 0.6, 1.2)  # rad, reach around it that stays clear of table and base
# reach of other arms, share of half a joint's range. A choice of half the default `share`, for nothing is known of what
# stands around them. Of 1500 postures of the iiwa14 in such a box around the middle of its ranges, none touches arm or
# table; at 0.6 none either, at 0.8 every 60th is below the table.
REACH = 0.4


class Robot(Protocol):
    """Robot properties that a motion needs."""

    @property
    def joints(self) -> Sequence[str]:
        """Names of the joints."""
        ...

    @property
    def range(self) -> np.ndarray:
        """Lower and upper limit of each joint, (nj, 2) rad."""
        ...

    @property
    def velocity_limit(self) -> np.ndarray:
        """Greatest speed of each joint, (nj,) rad/s; inf if unknown."""
        ...


Trajectory = tuple[np.ndarray, np.ndarray]  # angles (n, nj) rad, and speeds (n, nj) rad/s


@dataclass(frozen=True)
class Motion:
    """A commanded motion: time (n,) s, q_cmd and dq_cmd (n, nj) rad and rad/s.

    `ee_cmd` (n, 7), a motion of the flange by position in m and quaternion (w, x, y, z), is None for other motions.
    """

    name: str
    time: np.ndarray
    q_cmd: np.ndarray
    dq_cmd: np.ndarray
    ee_cmd: np.ndarray | None = None


@dataclass(frozen=True)
class Room:
    """Bounds of a motion.

    Attributes:
        joints: names.
        time: (n,) s.
        centre: (nj,) rad, posture to move around.
        reach: (nj,) rad, largest distance from it.
        speed: (nj,) rad/s, largest speed.
    """

    joints: tuple[str, ...]
    time: np.ndarray
    centre: np.ndarray
    reach: np.ndarray
    speed: np.ndarray

    @property
    def duration(self) -> float:
        """Duration in s, including the last sample period."""
        return float(self.time[-1] + self.time[1])


def smoothstep(u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the minimum-jerk step 10u^3-15u^4+6u^5 of u clipped to [0, 1]: its integral from 0, value and slope."""
    v = np.clip(u, 0.0, 1.0)
    integral = v**4 * (2.5 - 3.0 * v + v**2) + np.maximum(u - 1.0, 0.0)
    return integral, v**3 * (10.0 - 15.0 * v + 6.0 * v**2), 30.0 * v**2 * (1.0 - v) ** 2


def _fit(room: Room, q: np.ndarray, dq: np.ndarray, largest: float = np.inf) -> Trajectory:
    """Scale a motion (n, nj) about 0, joint by joint, until it just fits the bounds, and add the centre.

    A joint is enlarged by a factor of at most `largest`.
    """
    far, fast = np.abs(q).max(axis=0), np.abs(dq).max(axis=0)
    fits = np.minimum(room.reach / np.maximum(far, 1e-12), room.speed / np.maximum(fast, 1e-12))
    scale = np.minimum(largest, fits)
    return room.centre + scale * q, scale * dq


def fourier(room: Room, rng: np.random.Generator, harmonics: int = 5, base_hz: float | None = None) -> Trajectory:
    """Return a sum of `harmonics` sines with random phases, at multiples of `base_hz`.

    By default that is one period per recording, but at least 0.1 Hz.
    """
    t, nj = room.time, len(room.joints)
    base = max(0.1, 1.0 / room.duration) if base_hz is None else base_hz
    k = np.arange(1, harmonics + 1)
    weight = rng.uniform(0.5, 1.0, (harmonics, nj)) / np.sqrt(k)[:, None]
    phase = rng.uniform(0.0, 2.0 * np.pi, (harmonics, nj))
    angle = 2.0 * np.pi * base * k * t[:, None, None] + phase.T  # (n, nj, harmonics)
    f = (weight.T * np.sin(angle)).sum(axis=2)
    df = (weight.T * 2.0 * np.pi * base * k * np.cos(angle)).sum(axis=2)
    q, dq = _ramped(room, f, df)
    return _fit(room, q, dq)


def _ramped(room: Room, f: np.ndarray, df: np.ndarray) -> Trajectory:
    """Fade f, df (n, nj) in over the first fifth (at most 1 s), so that position, speed and acceleration start at 0."""
    length = min(1.0, room.duration / 5.0)
    _, w, dw = smoothstep(room.time[:, None] / length)
    return w * f, w * df + dw / length * f


def chirp(room: Room, rng: np.random.Generator, low_hz: float = 0.1, high_hz: float = 4.0) -> Trajectory:
    """Return sines of a frequency that rises from about `low_hz` to about `high_hz`.

    The amplitude falls with frequency so that the speed stays near its limit.
    """
    t, nj = room.time[:, None], len(room.joints)
    low, high = low_hz * rng.uniform(0.8, 1.25, nj), high_hz * rng.uniform(0.8, 1.25, nj)
    freq, dfreq = low + (high - low) * t / room.duration, (high - low) / room.duration
    angle = 2.0 * np.pi * (low * t + (high - low) * t**2 / (2.0 * room.duration)) + rng.uniform(0.0, 2.0 * np.pi, nj)
    ratio = 2.0 * np.pi * room.reach / room.speed  # s: speed at full reach over the speed limit, per Hz
    amp = room.reach / np.sqrt(1.0 + (ratio * freq) ** 2)
    damp = -room.reach * ratio**2 * freq * dfreq / (1.0 + (ratio * freq) ** 2) ** 1.5  # time derivative of amp
    f = amp * np.sin(angle)
    q, dq = _ramped(room, f, damp * np.sin(angle) + amp * 2.0 * np.pi * freq * np.cos(angle))
    return _fit(room, q, dq)


def triangle(room: Room, rng: np.random.Generator) -> Trajectory:
    """Return strokes of constant velocity out and back, at five speeds in random order."""
    slow, speeds, blend_s = 0.02, 5, 0.06  # rad/s, the lowest; their number; s, within which velocities change
    n, nj = len(room.time), len(room.joints)
    q, dq = np.zeros((n, nj)), np.zeros((n, nj))
    stroke = (room.duration - blend_s) / (2 * speeds)
    if stroke < 2.0 * blend_s:
        raise UserError(f"triangle: {speeds} speeds do not fit into the duration", got=f"{room.duration:g} s")
    for j in range(nj):
        fast = min(room.speed[j], room.reach[j] / stroke)
        size = rng.permutation(np.geomspace(min(slow, fast), fast, speeds))
        sign = rng.choice([-1.0, 1.0], speeds)
        velocity = np.repeat(size * sign, 2) * np.tile([1.0, -1.0], speeds)
        change = np.diff(np.concatenate([[0.0], velocity, [0.0]]))
        start = np.arange(2 * speeds + 1) * stroke
        start[1:-1] += rng.uniform(-0.15, 0.15) * stroke  # joints do not reverse together
        integral, value, _ = smoothstep((room.time[:, None] - start) / blend_s)
        q[:, j], dq[:, j] = (change * integral).sum(axis=1) * blend_s, (change * value).sum(axis=1)
    return _fit(room, q, dq, largest=1.0)


def steps(room: Room, rng: np.random.Generator, count: int = 6, smallest: float = 0.005) -> Trajectory:
    """Return `count` minimum-jerk steps with rests, from `smallest` rad to the reach, at each joint's own times."""
    n, nj = len(room.time), len(room.joints)
    q, dq = np.zeros((n, nj)), np.zeros((n, nj))
    slot = room.duration / count
    for j in range(nj):
        largest = min(room.reach[j], 0.6 * slot * room.speed[j] / 1.875)  # 1.875: peak over mean speed of the step
        size = rng.permutation(np.geomspace(min(smallest, largest), largest, count))
        here, begin = 0.0, rng.uniform(0.0, 0.2) * slot
        for k, move in enumerate(size):
            move *= rng.choice([-1.0, 1.0])
            move = -move if abs(here + move) > room.reach[j] else move
            here += move
            length = min(0.6 * slot, max(0.1, 1.875 * abs(move) / room.speed[j]))
            _, value, slope = smoothstep((room.time - begin - k * slot) / length)
            q[:, j] += move * value
            dq[:, j] += move * slope / length
    return _fit(room, q, dq, largest=1.0)


def sweep(room: Room, rng: np.random.Generator, joint: str | None = None) -> Trajectory:
    """Move one joint through its reach and back while the others rest; every joint in turn if none is named."""
    if joint is not None and joint not in room.joints:
        raise UserError("sweep: no such joint", got=joint, choices=room.joints)
    moving = range(len(room.joints)) if joint is None else [room.joints.index(joint)]
    q, dq = np.zeros((len(room.time), len(room.joints))), np.zeros((len(room.time), len(room.joints)))
    slot = room.duration / len(moving)
    for k, j in enumerate(moving):
        _, value, slope = smoothstep((room.time - k * slot) / slot)  # eased, so that it starts at rest
        sign = rng.choice([-1.0, 1.0])
        q[:, j] = sign * room.reach[j] * np.sin(2.0 * np.pi * value)
        dq[:, j] = sign * room.reach[j] * 2.0 * np.pi * np.cos(2.0 * np.pi * value) * slope / slot
    return _fit(room, q, dq)


def mix(room: Room, rng: np.random.Generator) -> Trajectory:
    """Move a random half of the joints on triangles, the rest on chirps: slow reversals and fast oscillation."""
    qt, dqt = triangle(room, rng)
    qc, dqc = chirp(room, rng)
    slow = rng.permutation(len(room.joints)) < (len(room.joints) + 1) // 2
    return np.where(slow, qt, qc), np.where(slow, dqt, dqc)


MOTIONS: dict[str, Callable[..., Trajectory]] = {f.__name__: f for f in (fourier, chirp, triangle, steps, sweep, mix)}


def osc_targets(
    room: Room, rng: np.random.Generator, model: Any, count: int = 9, reach_m: float = 0.06, turn_rad: float = 0.2
) -> np.ndarray:
    """Return flange targets (n, 7): from the pose at the centre posture, `count` minimum-jerk moves of equal duration.

    Each ends at a random pose near that pose, up to `reach_m` along each axis and `turn_rad` about each.

    Args:
        room: the bounds; only time and centre are used.
        rng: random generator.
        model: a compiled mujoco.MjModel with a site `flange` and the robot's joints first in qpos.
        count: number of moves.
        reach_m, turn_rad: largest offsets.
    """
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[: len(room.centre)] = room.centre
    mujoco.mj_kinematics(model, data)
    site = model.site("flange").id
    home, turn = data.site_xpos[site].copy(), np.zeros(4)
    mujoco.mju_mat2Quat(turn, data.site_xmat[site])
    goals = np.concatenate([np.zeros((1, 6)), rng.uniform(-1.0, 1.0, (count, 6))]) * ([reach_m] * 3 + [turn_rad] * 3)
    _, share, _ = smoothstep(room.time[:, None] / room.duration * count - np.arange(count))
    offset = share @ np.diff(goals, axis=0)  # (n, 6)
    out = np.empty((len(room.time), 7))
    out[:, :3] = home + offset[:, :3]
    for row, vector in zip(out, offset[:, 3:], strict=True):
        angle = np.linalg.norm(vector)
        spin, quat = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(4)
        if angle > 0.0:
            mujoco.mju_axisAngle2Quat(spin, vector / angle, angle)
        mujoco.mju_mulQuat(quat, spin, turn)
        row[3:] = quat
    return out


def room_of(
    robot: Robot, rate_hz: float, duration: float, centre: Sequence[float] | None = None, share: float = 0.8
) -> Room:
    """Return the bounds of motions within `share` of the limits around the posture `centre`.

    By default a seven-axis arm moves around a posture clear of the table if its limits allow that one, any other robot
    around the middle of its ranges. Joints without limits get half a turn to either side, and 2 rad/s.
    """
    nj, limits = len(robot.joints), np.asarray(robot.range, float)
    check_length(duration, rate_hz)
    n = round(duration * rate_hz)
    free = ~np.isfinite(limits).all(axis=1) | (limits[:, 0] >= limits[:, 1])
    low, high = np.where(free, -np.pi, limits[:, 0]), np.where(free, np.pi, limits[:, 1])
    mid, half = (low + high) / 2.0, (high - low) / 2.0
    seven = nj == 7 and centre is None and bool((np.abs(np.array(SEVEN_AXIS_CENTRE) - mid) < share * half).all())
    at = np.array(SEVEN_AXIS_CENTRE) if seven else mid if centre is None else np.asarray(centre, float)
    if at.shape != (nj,) or (np.abs(at - mid) >= share * half).any():
        raise UserError(
            f"the centre posture must lie well inside the position limits, in the middle {100 * share:g} %",
            got=list(at),
        )
    reach = np.minimum(share * half - np.abs(at - mid), SEVEN_AXIS_REACH if seven else REACH * half)
    limit = np.asarray(robot.velocity_limit, float)
    speed = share * np.where(np.isfinite(limit) & (limit > 0.0), limit, 2.0)
    return Room(tuple(robot.joints), np.arange(n) / rate_hz, at, reach, speed)


def motion(
    name: str,
    robot: Robot,
    rate_hz: float,
    duration: float,
    rng: np.random.Generator,
    *,
    centre: Sequence[float] | None = None,
    share: float = 0.8,
    **options: Any,
) -> Motion:
    """Return a commanded motion by name.

    Args:
        name: one of `MOTIONS`, or `osc` (which needs `model=` a compiled mujoco.MjModel).
        robot: anything with joints, range (nj, 2) rad and velocity_limit (nj,) rad/s.
        rate_hz, duration: samples a second, seconds.
        rng: random generator.
        centre: posture (nj,) rad around which to move; by default that of `room_of`.
        share: usable share of the position and velocity limits.
        options: the motion's own.
    """
    room = room_of(robot, rate_hz, duration, centre, share)
    choices = (*MOTIONS, "osc")
    if name not in choices:
        raise UserError("unknown motion", got=name, choices=choices)
    if name == "osc":
        still = np.tile(room.centre, (len(room.time), 1))
        return Motion(name, room.time, still, np.zeros_like(still), osc_targets(room, rng, **options))
    q, dq = MOTIONS[name](room, rng, **options)
    return Motion(name, room.time, q, dq)
