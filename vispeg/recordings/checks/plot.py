"""Plot a recording: angle, speed and torque of every joint, with faults marked."""

from __future__ import annotations

from io import BytesIO

import numpy as np

from vispeg.core.lines import thin
from vispeg.recordings.checks.check import CheckReport
from vispeg.recordings.checks.joint_check import smoothed
from vispeg.recordings.checks.quality import Limits, saturated
from vispeg.recordings.checks.spikes import without
from vispeg.recordings.checks.timing import Timing, within_episode
from vispeg.recordings.recording import Recording

MEASURED, COMMANDED, LIMIT, LOST, CLIPPED = "#1f5a94", "#e07b39", "#888888", "#d62728", "#b30000"
MAX_POINTS = 6000
MOST_GAPS = 200  # bands drawn at most: more would merge to one red area and take minutes


def plot(rec: Recording, report: CheckReport, limits: Limits | None = None) -> bytes:
    """Return a PNG with one row per joint and columns q (rad), dq (rad/s), tau (N m); episodes follow each other.

    Gaps are red bands; bad readings and saturated torque are thick red dots; limits are dashed where the motion comes
    near them. A long recording is thinned to the lowest and highest value of every stretch, so that peaks stay visible.
    Lines end at gaps and at the end of an episode.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    time, ends = laid_out(rec), line_ends(rec, report.timing)
    lined = cut(time, ends, between=True)

    def line(axis, values, colour: str, width: float) -> None:
        axis.plot(*thin(lined, cut(values, ends), MAX_POINTS), color=colour, lw=width)

    torque, torque_name = (rec.tau, "measured") if rec.tau is not None else (rec.tau_cmd, "commanded")
    nj = len(rec.joints)
    figure = Figure(figsize=(13, 0.8 + 1.35 * nj), dpi=110, layout="constrained")
    axes = figure.subplots(nj, 3, squeeze=False, sharex=True)
    for j, name in enumerate(rec.joints):
        position, velocity, effort = axes[j]
        spikes = report.joints[j].spikes
        if rec.q_cmd is not None:
            line(position, rec.q_cmd[:, j], COMMANDED, 0.8)
        line(position, without(rec.q[:, j], spikes), MEASURED, 0.9)
        bad = [spike.row for spike in spikes]
        position.plot(time[bad], rec.q[bad, j], ".", color=CLIPPED, ms=5)
        line(velocity, smoothed(rec, j, report.timing, spikes)[1], MEASURED, 0.9)
        if torque is not None:
            line(effort, torque[:, j], MEASURED, 0.7)
            top = float(limits.torque[j]) if limits else np.inf
            clipped = saturated(torque[:, j], 1.0 / report.timing.rate_hz, top)
            effort.plot(*thin(time[clipped], torque[clipped, j], MAX_POINTS), ".", color=CLIPPED, ms=4)
        if limits is not None:
            for axis, bounds in (
                (position, limits.range[j]),
                (velocity, (-limits.velocity[j], limits.velocity[j])),
                (effort, (-limits.torque[j], limits.torque[j])),
            ):
                _limits(axis, bounds)
        position.set_ylabel(name, fontsize=8)
        for axis in axes[j]:
            axis.tick_params(labelsize=7)
            axis.grid(alpha=0.25, lw=0.5)
            for gap in sorted(report.timing.gaps, key=lambda gap: -gap.seconds)[:MOST_GAPS]:
                axis.axvspan(time[gap.row], time[gap.row + 1], color=LOST, alpha=0.25, lw=0)
    titles = ("angle, rad" + (" (command orange)" if rec.q_cmd is not None else ""), "speed, rad/s")
    for axis, title in zip(axes[0], (*titles, f"torque, N m ({torque_name})"), strict=True):
        axis.set_title(title, fontsize=9)
    for axis in axes[-1]:
        axis.set_xlabel("time, s", fontsize=8)
    figure.suptitle(f"{rec.name}: {rec.robot.rsplit('/', 1)[-1]}, {rec.control.mode} control {rec.motion}", fontsize=10)
    figure.align_ylabels(axes[:, 0])
    out = BytesIO()
    figure.savefig(out, format="png")
    return out.getvalue()


def laid_out(rec: Recording) -> np.ndarray:
    """Return a time axis (n,) in s that starts at zero and continues across episodes."""
    step = np.diff(rec.time)
    step[~within_episode(rec)] = 1.0 / rec.rate_hz
    return np.concatenate([[0.0], np.cumsum(step)])


def line_ends(rec: Recording, clock: Timing) -> np.ndarray:
    """Return the rows before gaps in the clock, and the last row of each episode but the last one."""
    return np.union1d(np.flatnonzero(~within_episode(rec)), [gap.row for gap in clock.gaps]).astype(int)


def cut(values: np.ndarray, ends: np.ndarray, between: bool = False) -> np.ndarray:
    """Insert a row into (n, ..) after each of the rows `ends`: NaN, or the middle of its neighbours if `between`."""
    rows = (values[ends] + values[ends + 1]) / 2 if between else np.nan
    return np.insert(np.asarray(values, float), ends + 1, rows, axis=0)


def _limits(axis, bounds) -> None:
    """Draw limits that the data come near; distant ones would only flatten the curve."""
    low, high = axis.get_ylim()
    for bound in bounds:
        if np.isfinite(bound) and low - 0.2 * (high - low) <= bound <= high + 0.2 * (high - low):
            axis.axhline(bound, color=LIMIT, ls="--", lw=0.8)
