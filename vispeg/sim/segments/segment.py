"""A stretch of a recording, prepared as the input of a rollout."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from vispeg.recordings.checks.missing import stretches
from vispeg.recordings.differentiate import bridged, smooth
from vispeg.recordings.noise import noise_of
from vispeg.recordings.recording import Control, Recording

EXTERNAL = "external"  # key in `Segment.cache`: (n, nj) N m, torques on the links held from each tick to the next
START_HZ = 20.0  # bandwidth of the motion that gives a closed loop its start state
SERVO_TICK = 2.5e-3  # s, greatest spacing of the instants at which a new goal may reach a servo
NEAR = 0.05  # ticks by which a sample may be off its own tick: jitter, and the 0.2 us steps of times since 1970
HELD_HZ = 40.0  # bandwidth of the observer's reference motion, high enough to keep its corners
DEGREE = 3  # of the polynomial whose value at its left end is the start state
FEWEST = 2 * (DEGREE + 3)  # readings in a window: twice the coefficients of the polynomial with two more degrees
WINDOWS = (0.6, 0.42, 0.3, 0.21, 0.15, 0.1, 0.07)  # s, longest first, as a long window has the least noise
# Decrease of chi squared by two more degrees above which a window is too long; noise alone stays below in 95 % of cases
SUSPECT = 6.0


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
    grid = np.arange(int(np.floor(time[-1] / tick + NEAR)) + 1) * tick
    same_clock = len(grid) == len(time) and bool(np.all(np.abs(grid - time) < NEAR * tick))

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
    if rec.control.mode in ("osc", "servo"):  # here errors of the start state decay slowly
        q[0], dq[0] = start_state(time, bridged(time, read), noise_of(rec)["q"])
    return Segment(rec.control, tick, command, q, dq, raw, time, rows, float(rec.elapsed[rows[0]]))


def _continuous(quaternions: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4) of the same rotations, each with the sign that is nearer to the one before."""
    out, present = quaternions.copy(), np.isfinite(quaternions).all(axis=1)
    read = out[present]
    flips = np.sum(read[1:] * read[:-1], axis=1) < 0
    out[present] = read * np.cumprod(np.where(np.r_[False, flips], -1.0, 1.0))[:, None]
    return out


def start_state(time: np.ndarray, q: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate angle (nj,) rad and velocity (nj,) rad/s at `time[0]`.

    A cubic is fitted to the longest window in which a quintic would not fit significantly better (if there is none, a
    quintic to the shortest). The velocity error at its end is about 35 sigma / (T sqrt n). A smoother that passes
    through the first reading would keep that reading's full noise; it is used where no window has enough readings.

    Args:
        time: (n,) s, increasing; n >= 2.
        q: (n, nj) rad, readings at these times, not resampled, as each counts as one with noise of its own; missing
            ones are bridged.
        sigma: (nj,) rad, white noise.
    """
    smoothed = smooth(time[: 2 * FEWEST], q[: 2 * FEWEST], START_HZ)
    fits = [_fit_start(time - time[0], column, s) for column, s in zip(q.T, sigma, strict=True)]
    found = [fit or (angle[0], speed[0]) for fit, angle, speed in zip(fits, smoothed[0].T, smoothed[1].T, strict=True)]
    return np.array([angle for angle, _ in found]), np.array([speed for _, speed in found])


def _fit_start(time: np.ndarray, q: np.ndarray, sigma: float) -> tuple[float, float] | None:
    """Return the angle, rad, and velocity, rad/s, of one joint at time 0; None if no window has enough readings.

    See `start_state`.
    """
    best = None
    for span in WINDOWS:
        n = int(np.searchsorted(time, span, side="right"))
        if n < FEWEST or time[-1] < span:
            continue
        t, y = time[:n] / time[n - 1], q[:n] - q[0]
        fits = [np.polynomial.Legendre.fit(t, y, degree, domain=[0.0, 1.0]) for degree in (DEGREE, DEGREE + 2)]
        misfit = [np.sum((y - fit(t)) ** 2) for fit in fits]
        enough = misfit[0] - misfit[1] < SUSPECT * sigma**2
        fit = fits[0 if enough else 1]  # even the shortest window may be too long for a cubic
        best = float(q[0] + fit(0.0)), float(fit.deriv()(0.0) / time[n - 1])
        if enough:
            break
    return best
