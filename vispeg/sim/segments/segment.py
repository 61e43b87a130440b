"""A stretch of a recording, prepared as the input of a rollout."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from vispeg.recordings.checks.missing import stretches
from vispeg.recordings.differentiate import bridged, smooth
from vispeg.recordings.noise import noise_of
from vispeg.recordings.recording import Control, Recording
from vispeg.recordings.validate import MAX_ANGLE

EXTERNAL = "external"  # key in `Segment.cache`: (n, nj) N m, external torques on the links at the control ticks
START_HZ = 20.0  # bandwidth of the motion that gives a closed loop its start state
SERVO_TICK = 2.5e-3  # s, greatest spacing of the instants at which a new goal may reach a servo
HELD_HZ = 40.0  # bandwidth of the observer's reference motion, high enough to keep its corners
# Start states: how long the roughness of a motion counts as constant, s, and over how many readings at least.
CONSTANT_S, CONSTANT = 0.3, 12
# Values of it that are tried, half a decade apart: white noise of the jerk, rad/s^2.5, for which the acceleration
# changes in 0.1 s by 0.0003 rad/s^2 (at rest) to 300 rad/s^2
ROUGHNESS = np.logspace(-3, 3, 13)
# 1-sigma of velocity, rad/s, and acceleration, rad/s^2, before any reading: no arm is faster
FASTEST = (10.0, 1e3)


@dataclass(frozen=True)
class Segment:
    """One episode on the controller's clock.

    Attributes:
        control: the recorded controller.
        tick: control period, s; for a servo, the spacing of the grid on which its goals are held.
        command: name -> (n, ...) on the control grid: those of `q_cmd`, `dq_cmd`, `tau_cmd`, `ee_cmd` that the
            recording has.
        q, dq: (n, nj) smoothed measured motion on the control grid: start state and observer reference.
        q_raw: (n, nj) measured angles on the control grid, as the controller read them.
        time: (m,) sample times relative to the first tick, s.
        rows: (m,) row numbers in the recording.
        begun: time of the first tick on the recording's clock, s.
        cache: nominal quantities along the motion, computed once (inertia, gravity and its slope).
    """

    control: Control
    tick: float
    command: dict[str, np.ndarray]
    q: np.ndarray
    dq: np.ndarray
    q_raw: np.ndarray
    time: np.ndarray
    rows: np.ndarray
    begun: float = 0.0
    cache: dict = field(default_factory=dict, compare=False, repr=False)

    @property
    def ticks(self) -> int:
        """Number of control ticks."""
        return len(self.q)

    def until(self, count: int) -> Segment:
        """Cut the segment after `count` samples; later ones are not simulated."""
        ticks = min(self.ticks, max(2, math.ceil(self.time[count - 1] / self.tick - 1e-6) + 1))
        command = {name: values[:ticks] for name, values in self.command.items()}
        q, dq, raw = (values[:ticks] for values in (self.q, self.dq, self.q_raw))
        return Segment(self.control, self.tick, command, q, dq, raw, self.time[:count], self.rows[:count], self.begun)


def segments(rec: Recording) -> list[Segment]:
    """Convert episodes to segments.

    Commands stay as they are where samples match control ticks; else a servo's are held and others interpolated. An
    episode is split where its inputs are missing for long. Stretches shorter than a control period are left out.
    """
    episode = rec.episode if rec.episode is not None else np.zeros(len(rec.time), int)
    runs = [run for e in np.unique(episode) for run in stretches(rec, np.flatnonzero(episode == e))]
    tick = (1 - 1e-6) / rec.control.rate_hz
    return [_segment(rec, run) for run in runs if len(run) > 1 and rec.time[run[-1]] - rec.time[run[0]] >= tick]


def _segment(rec: Recording, rows: np.ndarray) -> Segment:
    time = rec.time[rows] - rec.time[rows[0]]
    tick, servo = 1.0 / rec.control.rate_hz, rec.control.mode == "servo"
    if servo:  # goals arrive at any time, and a servo's own loop is faster than any log
        tick /= np.ceil(tick / SERVO_TICK - 1e-9)
    grid = np.arange(int(np.floor(time[-1] / tick + 1e-6)) + 1) * tick
    same_clock = len(grid) == len(time) and bool(np.all(np.abs(grid - time) < 0.05 * tick))

    def on_grid(values: np.ndarray, held: bool = False) -> np.ndarray:
        values = bridged(time, values)  # the controller itself had no gap
        if same_clock:
            return values
        if held:
            return values[np.clip(np.searchsorted(time, grid + 1e-9, side="right") - 1, 0, None)]
        return np.stack([np.interp(grid, time, v) for v in values.T], axis=1)

    command = {
        name: on_grid(values[rows], servo)
        for name in ("q_cmd", "dq_cmd", "tau_cmd")
        if (values := getattr(rec, name)) is not None
    }
    if rec.ee_cmd is not None:
        pose = on_grid(np.hstack([rec.ee_cmd[rows, :3], _continuous(rec.ee_cmd[rows, 3:])]))
        pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
        command["ee_cmd"] = pose
    read = rec.q[rows]
    raw = on_grid(read)
    closed = rec.control.mode in ("position", "osc", "servo")
    q, dq, _ = smooth(grid, raw, START_HZ if closed else HELD_HZ)
    if closed:  # the loop forgets its start state only slowly where it is soft or its arm heavy
        q[0], dq[0] = start_state(time, read, noise_of(rec)["q"])
    return Segment(rec.control, tick, command, q, dq, raw, time, rows, float(rec.time[rows[0]]))


def _continuous(quaternions: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4) of the same rotations, each with the sign that is nearer to the one before."""
    out, present = quaternions.copy(), np.isfinite(quaternions).all(axis=1)
    read = out[present]
    flips = np.sum(read[1:] * read[:-1], axis=1) < 0
    out[present] = read * np.cumprod(np.where(np.r_[False, flips], -1.0, 1.0))[:, None]
    return out


def start_state(time: np.ndarray, q: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate angle (nj,) rad and velocity (nj,) rad/s at `time[0]`.

    A Kalman filter runs back in time from `CONSTANT_S` later to the start, for a jerk that is white noise. Each joint's
    roughness, the noise's density, is not known: values are tried, and their estimates averaged by their likelihood.
    If the readings are more likely for an arm at rest, as most recordings begin, the velocity is 0: a motion that sets
    in at once is rougher than what was before it.

    Args:
        time: (n,) s, increasing; n >= 2.
        q: (n, nj) rad, readings at these times, not resampled, as each counts as one with noise of its own; NaN where
            missing.
        sigma: (nj,) rad, white noise.
    """
    first = max(CONSTANT, int(np.searchsorted(time - time[0], CONSTANT_S, side="right")))
    q, steps = q[:first][::-1], np.diff(time[:first])[::-1]
    guess = np.nan_to_num(q[-1])  # angles are counted from here, which keeps the digits of long turns
    state = np.zeros((q.shape[1], len(ROUGHNESS), 3))  # angle, velocity, acceleration
    spread = np.broadcast_to(np.diag([MAX_ANGLE, *FASTEST]) ** 2, (*state.shape, 3))
    likelihood = np.zeros(state.shape[:2])
    for k, read in enumerate(q - guess):
        if k:
            h = -steps[k - 1]
            along = np.array([[1.0, h, h**2 / 2], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
            added = [[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]]
            state = state @ along.T
            spread = along @ spread @ along.T - np.array(added) * (ROUGHNESS**2)[:, None, None]  # h < 0
        seen = np.isfinite(read)[:, None]
        variance = spread[..., 0, 0] + (sigma**2)[:, None]
        off = np.where(seen, np.nan_to_num(read)[:, None] - state[..., 0], 0.0)
        gain = np.where(seen[..., None], spread[..., 0] / variance[..., None], 0.0)
        likelihood -= np.where(seen, np.log(variance) + off**2 / variance, 0.0) / 2
        state = state + gain * off[..., None]
        spread = spread - gain[..., None] * spread[..., None, 0, :]
    weight = np.exp(likelihood - likelihood.max(axis=1, keepdims=True))
    weight = (weight / weight.sum(axis=1, keepdims=True))[..., None]
    mean = (weight * state).sum(axis=1)
    around = state - mean[:, None]
    with_speed = (weight * (spread[..., 1] + around * around[..., 1:2])).sum(axis=1)  # covariances with the velocity
    (angle, speed, _), (shared, square, _) = mean.T, with_speed.T
    # evidence for a velocity from the broad prior, over that for 0
    if np.sum(speed**2 / square - np.log(FASTEST[0] ** 2 / square)) < 0:
        return guess + angle - shared / square * speed, np.zeros_like(speed)
    return guess + angle, speed
