"""One joint's commanded and measured motion, and the stretches of it that each protocol reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from vispeg.core.errors import UserError
from vispeg.recordings.load import load
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Reading
from vispeg.recordings.validate import check_angles
from vispeg.robots.model import load as load_robot
from vispeg.sim.compiled import nominal_of
from vispeg.sim.units import check_units

NEEDED = ("time", "q_cmd", "q")
COLUMNS = (*NEEDED, "tau")
HOLD = 0.25  # s that a command rests before and after a step
SHORT = 0.3  # s within which a command that moves between two rests is a step
STEP_WINDOW = 3.0  # s of the answer to a step that are looked at
RAMP = 0.3  # s of constant commanded speed that count as a ramp
PERIODS, LIKE = 3, 0.05  # of a sine, and by how much its half periods may differ
PURE = 0.05  # of its RMS that a sine may leave; a triangle leaves 0.12
SLOWEST = 0.1  # s between rows: a step's window (`steps.BEFORE`, `HOLD`) holds two of them
SLOW = 0.5  # s over which command and angle are averaged to see whether the one follows the other
FOLLOWS = 2.0  # factor about 1 of angle over command: a servo reaches its goal within 20 %, degrees are a factor of 57
LEAD = 0.5  # s before its command within which an angle is looked for
LIKELIER = 4.0  # residual's ratio of squares that says that the angle leads: half the error


@dataclass(frozen=True)
class Trace:
    """Arrays (n,): time s, q_cmd and q rad, the motor's tau N m, or None and `why`; `name` is the file's.

    `servo`: the loop is the robot's own, so that the second-order answer is an effect of its drive. `asked`: tau is
    what the control law asks for, not what the motor gave.
    """

    name: str
    time: np.ndarray
    q_cmd: np.ndarray
    q: np.ndarray
    tau: np.ndarray | None = None
    why: str = "no torque was recorded"
    servo: bool = False
    asked: bool = False

    @property
    def period(self) -> float:
        """Sample period, s."""
        return float(np.median(np.diff(self.time)))

    def signed(self) -> bool:
        """Whether there is a torque with a sign: what touches zero and never goes below is a magnitude."""
        if self.tau is None:
            return False
        least, most = self.tau.min(), np.abs(self.tau).max()
        return bool(least < -0.05 * most or least > 0.2 * most)


def from_recording(path: Path, joint: str | None) -> tuple[list[Trace], str, str]:
    """Return the traces of a recording, one per episode, the joint (by default the one that moves most), and the robot.

    Raises:
        UserError: unreadable, in units that cannot be true, without commanded angles, or without that joint.
    """
    rec = load(path)
    check_units(rec)
    if rec.q_cmd is None:
        raise UserError("has no commanded angles", file=path, expected="columns q_cmd.<joint>")
    if joint is None:
        joint = rec.joints[int(np.argmax(np.nanstd(rec.q_cmd, axis=0)))]
    if joint not in rec.joints:
        raise UserError("no such joint", file=path, got=joint, choices=rec.joints)
    j = rec.joints.index(joint)
    episode = np.zeros(len(rec.time)) if rec.episode is None else rec.episode
    torque, why = motor_torque(rec, j)
    has_servo = rec.control.mode in ("servo", "unknown")
    asked = rec.torque_sensor != "motor"
    out = []
    for number in np.unique(episode):
        rows = (episode == number) & np.isfinite(rec.q[:, j]) & np.isfinite(rec.q_cmd[:, j])
        tau = None if torque is None or not np.isfinite(torque[rows]).all() else torque[rows]
        arrays = rec.time[rows], rec.q_cmd[rows, j], rec.q[rows, j], tau
        out.append(_checked(Trace(path.name, *arrays, why, has_servo, asked), path))
    return out, joint, rec.robot


def motor_torque(rec: Recording, j: int) -> tuple[np.ndarray | None, str]:
    """Return the motor torque of joint j before gear friction, (n,) N m; or None and the reason.

    The motor's own sensor; else the recorded control law, where it is known and its torque acts at once. A sensor
    behind the gear sees what the friction has left.
    """
    if rec.tau is not None and rec.torque_sensor == "motor":
        return rec.tau[:, j], ""
    law = rec.control
    if law.mode != "position" or law.kp is None or law.kd is None or rec.q_cmd is None:
        behind = "the torque sensor sits behind the gear, where friction does not show"
        return None, "no torque was recorded" if rec.tau is None or rec.torque_sensor == "none" else behind
    rate = np.gradient(rec.q[:, j], rec.time) if rec.dq is None else rec.dq[:, j]
    wanted = 0.0 if rec.dq_cmd is None else rec.dq_cmd[:, j]
    tau = law.kp[j] * (rec.q_cmd[:, j] - rec.q[:, j]) + law.kd[j] * (wanted - rate)
    return tau + (_weight(rec, j) if law.gravity_compensation == "model" else 0.0), ""


def _weight(rec: Recording, j: int) -> np.ndarray:
    """Nominal gravity torque (n,) N m of joint j, the others where they mostly are: on a grid of its angle."""
    robot = load_robot(rec.robot, tool=rec.tool, base_tilt=rec.base_tilt)
    angle = np.linspace(np.nanmin(rec.q[:, j]), np.nanmax(rec.q[:, j]), 33)
    posture = np.tile(np.nanmedian(rec.q, axis=0), (len(angle), 1))
    posture[:, j] = angle
    return np.interp(rec.q[:, j], angle, nominal_of(robot, len(angle), 1).gravity(posture)[:, j])


def from_table(path: Path, columns: Mapping[str, str]) -> Trace:
    """Give the trace in a .csv, .csv.gz or .parquet table.

    Args:
        path: of the table.
        columns: `time`, `q_cmd`, `q` and, where there is one, `tau` -> the column's name.

    Raises:
        UserError: a column is missing, not named, or no number; angles that look like degrees.
    """
    for name in columns:
        if name not in COLUMNS:
            raise UserError("unknown signal", key="--columns", got=name, choices=COLUMNS)
    for name in NEEDED:
        if name not in columns:
            raise UserError(f"{name} is not named", file=path, key="--columns", expected=f"{name}=COLUMN")
    table = read_table(path, Reading(keep=lambda names: [n for n in names if n in columns.values()]))
    values = {name: table.number(column) for name, column in columns.items()}
    for name in ("q", "q_cmd"):
        check_angles(table, values[name][:, None], [columns[name]])
    arrays = (values["time"], values["q_cmd"], values["q"], values.get("tau"))
    return _checked(Trace(path.name, *arrays, servo=True), path)


def _checked(trace: Trace, path: Path) -> Trace:
    if len(trace.time) < 20 or not (np.isfinite(trace.time).all() and (np.diff(trace.time) > 0).all()):
        raise UserError("not a motion", file=path, key="time", expected="20 strictly increasing times or more")
    if trace.period > SLOWEST:
        expected = f"a row every {SLOWEST:g} s or faster, times in s"
        raise UserError(
            "too slow, or times of another unit", file=path, key="time", expected=expected, got=trace.period
        )
    for name in ("q_cmd", "q", "tau"):
        values = getattr(trace, name)
        if values is not None and not np.isfinite(values).all():
            raise UserError("empty cells", file=path, key=name, expected="a number in each row")
    return trace


def refuse_no_servo(traces: Sequence[Trace], file: str) -> None:
    """Refuse angles that do not follow their command: stuck, reversed, in another unit, or ahead of it.

    Raises:
        UserError: slowly, the angle turns otherwise than its command by more than a factor of `FOLLOWS`; or it is
            nearer to the command of a later time than to any of now or before.
    """
    slow = [[_averaged(x, t.period) for x in (t.q_cmd, t.q)] for t in traces]
    power = sum(float(np.sum(u**2)) for u, _ in slow)
    if power > 0.01 * sum(float(np.sum((t.q_cmd - t.q_cmd.mean()) ** 2)) for t in traces):  # not of fast sines alone
        gain = sum(float(u @ y) for u, y in slow) / power
        if not 1.0 / FOLLOWS < gain < FOLLOWS:
            inverse = 1.0 / gain if gain else np.inf
            degrees = {"q_cmd": gain, "q": inverse}
            likely = [f", likely degrees in {n}" for n, g in degrees.items() if abs(g * 180 / np.pi - 1) < 0.2]
            how = "is turned round against" if gain < -1.0 / FOLLOWS else "does not follow"
            expected = "q of about q_cmd, both in rad and of one sense" + "".join(likely)
            raise UserError(
                f"the angle {how} its command", file=file, key="q", expected=expected, got=f"{gain:.3g} of it"
            )
    at = _lead(traces)
    if at > 0:
        expected = "q after q_cmd: are the columns swapped, or the commands logged late?"
        raise UserError("the angle moves before its command", file=file, key="q", expected=expected, got=f"{at:.2g} s")


def _averaged(x: np.ndarray, period: float) -> np.ndarray:
    """Average x (n,) over `SLOW` s and take off its mean."""
    width = max(1, min(round(SLOW / period), len(x)))
    slow = np.convolve(x, np.ones(width) / width, "valid")
    return slow - slow.mean()


def _lead(traces: Sequence[Trace]) -> float:
    """Time by which the angle leads its command, s; 0 where one as late as now, or later, does about as well."""
    lags = np.linspace(-LEAD, LEAD, 101)
    left = np.zeros(len(lags))
    for t in traces:
        inside = (t.time >= t.time[0] + LEAD) & (t.time <= t.time[-1] - LEAD)
        if inside.sum() < 3 or np.ptp(t.q_cmd[inside]) == 0:
            continue
        y = t.q[inside] - t.q[inside].mean()
        for k, lag in enumerate(lags):
            u = np.interp(t.time[inside] - lag, t.time, t.q_cmd)
            u = u - u.mean()
            left[k] += float(y @ y - (u @ y) ** 2 / max(u @ u, 1e-300))
    later = lags >= -2.0 * max(t.period for t in traces)  # a row of jitter, and one of rounding
    best = int(np.argmin(left))
    return 0.0 if later[best] or left[best] * LIKELIER >= left[later].min() else float(-lags[best])


def steps(trace: Trace) -> list[tuple[int, int]]:
    """(row of the first change, row of the end) of each step: a command that moves briefly between two rests."""
    changes = np.flatnonzero(np.abs(np.diff(trace.q_cmd)) > 1e-9) + 1
    if not len(changes):
        return []
    t = trace.time
    pauses = np.flatnonzero(np.diff(t[changes]) >= HOLD)
    first, last = changes[np.concatenate([[0], pauses + 1])], changes[np.concatenate([pauses, [len(changes) - 1]])]
    end = np.append(first[1:], len(t))
    out = []
    for a, b, stop in zip(first, last, end, strict=True):
        rest = t[a] - (t[0] if a == first[0] else t[last[last < a][-1]])
        if rest >= HOLD and t[b] - t[a] <= SHORT and t[stop - 1] - t[b] >= HOLD:
            out.append((int(a), int(min(stop, np.searchsorted(t, t[a] + STEP_WINDOW)))))
    return out


def ramps(trace: Trace) -> list[tuple[int, int, float]]:
    """(first row, last row, speed in rad/s) of each stretch of constant commanded speed."""
    dt = np.diff(trace.time)
    speed = np.diff(trace.q_cmd) / dt
    digit = 2e-6 / trace.period  # rad/s, of commands written to six decimals
    out, start = [], 0
    for k in range(1, len(speed) + 1):
        mean = (
            speed[start:k].mean()
            if k - start < 40
            else (trace.q_cmd[k - 1] - trace.q_cmd[start]) / (trace.time[k - 1] - trace.time[start])
        )
        if k < len(speed) and abs(speed[k] - mean) <= digit + 0.05 * abs(mean):
            continue
        if trace.time[k] - trace.time[start] >= RAMP and abs(mean) > 2 * digit / max(1, (k - start) / 20):
            out.append((start, k, float(mean)))
        start = k
    return out


def strokes(trace: Trace) -> list[tuple[tuple[int, int], tuple[int, int], float]]:
    """(out, back, speed): ramps that turn round at once and come back as fast, each (first row, last row)."""
    segments, out = ramps(trace), []
    for (a, b, v), (c, d, w) in zip(segments, segments[1:], strict=False):
        near = trace.time[c] - trace.time[b] < RAMP
        if near and v * w < 0 and abs(v + w) < 0.03 * abs(v):
            out.append(((a, b), (c, d), abs(v)))
    return out


def sines(trace: Trace) -> list[tuple[float, float, float, int]]:
    """(start s, period s, amplitude rad, periods) of each stretch of `PERIODS` periods or more of one sine."""
    x, t = trace.q_cmd, trace.time
    span = np.ptp(x)
    if span < 1e-6:
        return []
    tops = signal.find_peaks(x, prominence=0.02 * span)[0]
    lows = signal.find_peaks(-x, prominence=0.02 * span)[0]
    turns = np.sort(np.concatenate([tops, lows]))
    out, k = [], 0
    while k + 2 * PERIODS < len(turns):
        end = k + 1
        half, size = t[turns[k + 1]] - t[turns[k]], abs(x[turns[k + 1]] - x[turns[k]])
        while end < len(turns):
            gap, swing = t[turns[end]] - t[turns[end - 1]], abs(x[turns[end]] - x[turns[end - 1]])
            if abs(gap - half) > LIKE * half + 1.5 * trace.period or abs(swing - size) > 0.1 * size:
                break
            end += 1
        count = (end - 1 - k) // 2
        if count >= PERIODS:
            stretch = _pure(trace, int(turns[k]), int(turns[k + 2 * count]), count)
            out += [] if stretch is None else [stretch]
            k = end - 1
            continue
        k += 1
    return out


def _pure(trace: Trace, first: int, last: int, count: int) -> tuple[float, float, float, int] | None:
    """Give the stretch if it is a sine, its period refined by least squares."""
    from scipy.optimize import minimize_scalar

    t, x = trace.time[first : last + 1] - trace.time[first], trace.q_cmd[first : last + 1]
    guess = t[-1] / count

    def remainder(period: float) -> tuple[float, np.ndarray]:
        w = 2.0 * np.pi / period
        design = np.column_stack([np.cos(w * t), np.sin(w * t), np.ones_like(t)])
        c, *_ = np.linalg.lstsq(design, x, rcond=None)
        return float(np.std(x - design @ c)), c

    best = minimize_scalar(lambda p: remainder(p)[0], bounds=(0.97 * guess, 1.03 * guess), method="bounded")
    rest, c = remainder(float(best.x))
    amplitude = float(np.hypot(c[0], c[1]))
    if rest > PURE * amplitude / np.sqrt(2.0):
        return None
    periods = int(np.floor((trace.time[last] - trace.time[first]) / best.x + 0.02))
    return float(trace.time[first]), float(best.x), amplitude, max(periods, 1)
