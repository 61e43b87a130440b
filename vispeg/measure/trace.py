"""One joint's commanded and measured motion, and its division into steps, ramps, strokes and sines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from vispeg.core.errors import UserError
from vispeg.recordings.checks.missing import MOST
from vispeg.recordings.differentiate import differences
from vispeg.recordings.load import load
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Reading
from vispeg.recordings.validate import check_angles
from vispeg.sim.compiled import nominal_of
from vispeg.sim.recorded import with_robot
from vispeg.sim.units import check_units

NEEDED = ("time", "q_cmd", "q")
COLUMNS = (*NEEDED, "tau")
HOLD = 0.25  # s, least time for which the command rests before and after a step
SHORT = 0.3  # s, greatest duration of a command's motion between two rests that counts as a step
STEP_WINDOW = 3.0  # s of the response to a step that are used
RAMP = 0.3  # s, least duration of constant commanded speed that counts as a ramp
PERIODS, LIKE = 3, 0.05  # least number of periods of a sine; greatest relative difference of its half periods
PURE = 0.05  # greatest residual of a sine relative to its RMS; a triangle leaves 0.12
SLOWEST = 0.1  # s, greatest time between rows, so that a step's windows (`steps.BEFORE`, `HOLD`) contain two rows
SLOW = 0.5  # s over which command and angle are averaged to test whether the angle follows
FOLLOWS = 2.0  # greatest factor between angle and command: a servo is within 20 %, degrees make a factor of 57
LEAD = 0.5  # s, greatest time by which an angle may be found to lead its command
LIKELIER = 4.0  # ratio of squared residuals (half the error) at which the angle is said to lead


@dataclass(frozen=True, eq=False)
class Trace:
    """One joint's motion in one recording or episode.

    Attributes:
        name: of the file, and of the episode if there are several; used in messages only.
        time: (n,) s.
        q_cmd, q: (n,) commanded and measured angle, rad.
        tau: (n,) motor torque, N m; or None.
        why: reason if there is no torque.
        servo: whether the position loop is the robot's own; its second-order response is then an effect of the drive.
        asked: whether `tau` is what the control law asks for, not what the motor gave.
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
        """Return whether there is a torque with a sign; one that comes near 0 but is never negative is a magnitude."""
        if self.tau is None:
            return False
        least, most = self.tau.min(), np.abs(self.tau).max()
        return bool(least < -0.05 * most or least > 0.2 * most)


def angle_noise(traces: Sequence[Trace]) -> float:
    """Return the standard deviation of the angles' noise, rad: the median over the traces.

    A second difference of independent noise has sqrt(1 + 4 + 1) times its standard deviation.
    """
    return float(np.median([np.std(np.diff(t.q, 2)) for t in traces])) / np.sqrt(6.0)


def most_moved(paths: Sequence[Path]) -> str:
    """Return the joint whose command varies most within one of the recordings.

    Raises:
        UserError: a recording that cannot be read, or no commanded angles in any.
    """
    spread: dict[str, float] = {}
    for path in paths:
        rec = load(path, lambda header: ("q_cmd",))
        for joint, command in zip(rec.joints, () if rec.q_cmd is None else rec.q_cmd.T, strict=False):
            if np.isfinite(command).any():
                spread[joint] = max(spread.get(joint, 0.0), float(np.nanstd(command)))
    if not spread:
        raise UserError("has no commanded angles", file=paths[0], expected="columns q_cmd.<joint>")
    return max(spread, key=spread.__getitem__)


def from_recording(path: Path, joint: str) -> tuple[list[Trace], str]:
    """Return a joint's traces in a recording, one per episode, and the robot.

    Rows that lack the joint's command, angle or torque are left out; an episode that lacks the torque of more than the
    share `MOST` of its rows has none.

    Raises:
        UserError: a recording that cannot be read, with implausible units, without commanded angles, or without that
            joint.
    """
    rec = load(path)
    check_units(rec)
    if rec.q_cmd is None:
        raise UserError("has no commanded angles", file=path, expected="columns q_cmd.<joint>")
    if joint not in rec.joints:
        raise UserError("no such joint", file=path, got=joint, choices=rec.joints)
    j = rec.joints.index(joint)
    episode = np.zeros(len(rec.time)) if rec.episode is None else rec.episode
    torque, why = motor_torque(rec, j)
    has_servo = rec.control.mode in ("servo", "unknown")
    asked = rec.tau is None or rec.torque_sensor != "motor"
    out, numbers = [], np.unique(episode)
    for number in numbers:
        rows = (episode == number) & np.isfinite(rec.q[:, j]) & np.isfinite(rec.q_cmd[:, j])
        tau, reason = torque, why
        if tau is not None:
            complete = rows & np.isfinite(tau)
            if complete.sum() >= (1 - MOST) * rows.sum():
                rows = complete
            else:
                tau, reason = None, f"the torque is missing in more than {MOST:.0%} of the rows"
        arrays = rec.time[rows], rec.q_cmd[rows, j], rec.q[rows, j], None if tau is None else tau[rows]
        name = str(path) if len(numbers) == 1 else f"{path}, episode {number}"
        out.append(_checked(Trace(name, *arrays, reason, has_servo, asked), path))
    return out, rec.robot


def motor_torque(rec: Recording, j: int) -> tuple[np.ndarray | None, str]:
    """Return the motor torque of joint j before gear friction, (n,) N m; or None and the reason.

    It is that of the motor's sensor; else it is computed from the recorded control law, if that is known and commands
    torques. A torque sensor behind the gear does not show friction.
    """
    if rec.tau is not None and rec.torque_sensor == "motor":
        return rec.tau[:, j], ""
    law = rec.control
    if law.mode != "position" or law.kp is None or law.kd is None or rec.q_cmd is None:
        behind = "the torque sensor sits behind the gear, where friction does not show"
        return None, "no torque was recorded" if rec.tau is None or rec.torque_sensor == "none" else behind
    rate = differences(rec.time, rec.q[:, [j]], rec.episode)[:, 0] if rec.dq is None else rec.dq[:, j]
    wanted = 0.0 if rec.dq_cmd is None else rec.dq_cmd[:, j]
    tau = law.kp[j] * (rec.q_cmd[:, j] - rec.q[:, j]) + law.kd[j] * (wanted - rate)
    return tau + (_weight(rec, j) if law.gravity_compensation == "model" else 0.0), ""


def _weight(rec: Recording, j: int) -> np.ndarray:
    """Return the nominal gravity torque (n,) N m of joint j, interpolated over its angle.

    The other joints are taken at the medians of their angles.
    """
    joint = rec.joints[j]
    rec, robot = with_robot(rec)
    j = rec.joints.index(joint)
    angle = np.linspace(np.nanmin(rec.q[:, j]), np.nanmax(rec.q[:, j]), 33)
    posture = np.tile(np.nanmedian(rec.q, axis=0), (len(angle), 1))
    posture[:, j] = angle
    return np.interp(rec.q[:, j], angle, nominal_of(robot, len(angle), 1).gravity(posture)[:, j])


def from_table(path: Path, columns: Mapping[str, str]) -> Trace:
    """Read a trace from a .csv, .csv.gz or .parquet table.

    Args:
        path: of the table.
        columns: signal -> the column's name, for `time`, `q_cmd`, `q` and optionally `tau`.

    Raises:
        UserError: a column that is missing, not named, or not numbers; angles that look like degrees.
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
    return _checked(Trace(str(path), *arrays, servo=True), path)


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
        UserError: averaged over `SLOW` s, the angle differs from its command by more than a factor of `FOLLOWS`; or the
            angle fits the command of a later time much better than the present or an earlier command.
    """
    slow = [[_averaged(x, t.period) for x in (t.q_cmd, t.q)] for t in traces]
    power = sum(float(np.sum(u**2)) for u, _ in slow)
    # skipped if the averages are nearly constant, as for traces with only fast sines
    if power > 0.01 * sum(float(np.sum((t.q_cmd - t.q_cmd.mean()) ** 2)) for t in traces):
        gain = sum(float(u @ y) for u, y in slow) / power
        if not 1.0 / FOLLOWS < gain < FOLLOWS:
            inverse = 1.0 / gain if gain else np.inf
            degrees = {"q_cmd": gain, "q": inverse}
            likely = [f", likely degrees in {n}" for n, g in degrees.items() if abs(g * 180 / np.pi - 1) < 0.2]
            how = "is opposite to" if gain < -1.0 / FOLLOWS else "does not follow"
            expected = "q of about q_cmd, both in rad and with the same sign" + "".join(likely)
            raise UserError(
                f"the angle {how} its command", file=file, key="q", expected=expected, got=f"{gain:.3g} of it"
            )
    at = _lead(traces)
    if at > 0:
        expected = "q after q_cmd: are the columns swapped, or the commands logged late?"
        raise UserError("the angle moves before its command", file=file, key="q", expected=expected, got=f"{at:.2g} s")


def _averaged(x: np.ndarray, period: float) -> np.ndarray:
    """Return the moving average of x (n,) over `SLOW` s, minus its mean."""
    width = max(1, min(round(SLOW / period), len(x)))
    slow = np.convolve(x, np.ones(width) / width, "valid")
    return slow - slow.mean()


def _lead(traces: Sequence[Trace]) -> float:
    """Return the time by which the angle leads its command, s; 0 if no lead fits about as well."""
    lags = np.linspace(-LEAD, LEAD, 101)
    residual = np.zeros(len(lags))
    for t in traces:
        inside = (t.time >= t.time[0] + LEAD) & (t.time <= t.time[-1] - LEAD)
        if inside.sum() < 3 or np.ptp(t.q_cmd[inside]) == 0:
            continue
        y = t.q[inside] - t.q[inside].mean()
        for k, lag in enumerate(lags):
            u = np.interp(t.time[inside] - lag, t.time, t.q_cmd)
            u = u - u.mean()
            residual[k] += float(y @ y - (u @ y) ** 2 / max(u @ u, 1e-300))
    later = lags >= -2.0 * max(t.period for t in traces)  # no lead, with two rows of tolerance for jitter and rounding
    best = int(np.argmin(residual))
    return 0.0 if later[best] or residual[best] * LIKELIER >= residual[later].min() else float(-lags[best])


def steps(trace: Trace) -> list[tuple[int, int]]:
    """Return the rows (first change, end) of each step, that is of a command that moves briefly between two rests."""
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
    """Return (first row, last row, speed in rad/s) of each stretch of constant commanded speed."""
    dt = np.diff(trace.time)
    speed = np.diff(trace.q_cmd) / dt
    digit = 2e-6 / trace.period  # rad/s, of commands written to six decimals
    out, start = [], 0
    for k in range(1, len(speed) + 1):
        # over many rows the slope between the ends, nearly the mean speed but as quick for any number of rows
        mean = (
            speed[start:k].mean()
            if k - start < 40
            else (trace.q_cmd[k - 1] - trace.q_cmd[start]) / (trace.time[k - 1] - trace.time[start])
        )
        if k < len(speed) and abs(speed[k] - mean) <= digit + 0.05 * abs(mean):
            continue
        # a mean speed that rounding of a resting command can make is no ramp; over more than 20 rows that speed falls
        if trace.time[k] - trace.time[start] >= RAMP and abs(mean) > 2 * digit / max(1, (k - start) / 20):
            out.append((start, k, float(mean)))
        start = k
    return out


def strokes(trace: Trace) -> list[tuple[tuple[int, int], tuple[int, int], float]]:
    """Return (out, back, speed) of pairs of ramps that reverse at once and return at the same speed, rad/s.

    `out` and `back` are (first row, last row).
    """
    segments, out = ramps(trace), []
    for (a, b, v), (c, d, w) in zip(segments, segments[1:], strict=False):
        near = trace.time[c] - trace.time[b] < RAMP
        if near and v * w < 0 and abs(v + w) < 0.03 * abs(v):
            out.append(((a, b), (c, d), abs(v)))
    return out


def sines(trace: Trace) -> list[tuple[float, float, float, int]]:
    """Return (start s, period s, amplitude rad, periods) of each stretch of at least `PERIODS` periods of one sine."""
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
    """Return a stretch as `sines` does, with its period refined by least squares; None if it is not a sine."""
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
