"""Check one joint of a recording: bad readings, limits, tracking, noise, excitation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vispeg.recordings.checks.excitation import Excitation, excitation
from vispeg.recordings.checks.quality import Limits, quantization, saturated
from vispeg.recordings.checks.spikes import Spike, spikes, without
from vispeg.recordings.checks.timing import Timing, within_episode
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.noise import highpass_sigma, silent
from vispeg.recordings.recording import Recording

SMOOTHING_HZ = 20.0  # bandwidth of the smoothed motion
OVER_ANGLE = 1e-3  # rad beyond a limit that noise does not reach
OVER_SPEED, OVER_TORQUE = 1.02, 1.02  # multiples of a limit that noise does not reach


@dataclass(frozen=True)
class JointCheck:
    """Check results for one joint of a recording, in SI units and radians; None if the signal is absent.

    Attributes:
        name: the joint.
        missing: share of its angle readings that are missing.
        longest_missing_s: the longest stretch without an angle reading, s.
        spikes: isolated bad readings; the statistics of angle and speed exclude them.
        low, high: extremes of the angle.
        tracking_rms, tracking_worst: commanded minus measured angle, RMS and largest size.
        peak_torque: largest measured torque.
        outside_range, over_velocity, over_torque: number of rows beyond the robot's limits.
        saturated: signal (`tau`, `tau_cmd`) -> number of clipped rows; signals without any are left out.
        quantum_q, quantum_tau: quantization step; None if none is detected.
        noise_q, noise_tau: 1-sigma noise estimated from fourth differences.
        excitation: how the joint was moved; without `sigma` if torque noise is neither stated nor visible.
    """

    name: str
    missing: float
    longest_missing_s: float
    spikes: tuple[Spike, ...]
    low: float
    high: float
    tracking_rms: float | None
    tracking_worst: float | None
    peak_torque: float | None
    outside_range: int
    over_velocity: int
    over_torque: int
    saturated: Mapping[str, int]
    quantum_q: float | None
    quantum_tau: float | None
    noise_q: float
    noise_tau: float | None
    excitation: Excitation


def smoothed(rec: Recording, j: int, clock: Timing, bad: tuple[Spike, ...]) -> tuple[np.ndarray, ...]:
    """Return smoothed angle, speed and acceleration (n,) of one joint, without its bad readings."""
    cutoff = min(SMOOTHING_HZ, 0.2 * clock.rate_hz)
    return tuple(part[:, 0] for part in smooth(rec.time, without(rec.q[:, j], bad)[:, None], cutoff, rec.episode))


def joint_check(rec: Recording, j: int, clock: Timing, limits: Limits | None) -> JointCheck:
    """Check the j-th joint of a recording; limits None where they are not known."""
    bad = spikes(rec.elapsed, rec.q[:, j])
    motion = smoothed(rec, j, clock, bad)
    q, speed = without(rec.q[:, j], bad), np.abs(motion[1])
    tau = None if rec.tau is None else rec.tau[:, j]
    dt = 1.0 / clock.rate_hz
    low, high = limits.range[j] if limits else (-np.inf, np.inf)
    top_speed, top_torque = (limits.velocity[j], limits.torque[j]) if limits else (np.inf, np.inf)
    torques = {name: v[:, j] for name in ("tau", "tau_cmd") if (v := getattr(rec, name)) is not None}
    clipped = {name: int(saturated(values, dt, float(top_torque)).sum()) for name, values in torques.items()}
    sigma_tau = None if tau is None else _sigma(tau)
    peak_tau = None if tau is None or np.isnan(tau).all() else float(np.nanmax(np.abs(tau)))
    used = float(rec.noise["tau"]) if tau is not None and "tau" in rec.noise else sigma_tau
    if "tau" not in rec.noise and silent(sigma_tau, peak_tau):
        used = None  # the signal was filtered: its remaining noise does not tell how precisely parameters can be known
    missing, longest = _missing(rec, rec.q[:, j])
    off = None if rec.q_cmd is None else np.abs(rec.q_cmd[:, j] - q)
    off = None if off is None or np.isnan(off).all() else off
    return JointCheck(
        name=rec.joints[j],
        missing=missing,
        longest_missing_s=longest,
        spikes=bad,
        low=float(np.nanmin(q)),
        high=float(np.nanmax(q)),
        tracking_rms=None if off is None else float(np.sqrt(np.nanmean(off**2))),
        tracking_worst=None if off is None else float(np.nanmax(off)),
        peak_torque=peak_tau,
        outside_range=int(np.sum((q < low - OVER_ANGLE) | (q > high + OVER_ANGLE))),
        over_velocity=int(np.sum(speed > OVER_SPEED * top_speed)),
        over_torque=0 if tau is None else int(np.sum(np.abs(tau) > OVER_TORQUE * top_torque)),
        saturated={name: count for name, count in clipped.items() if count},
        quantum_q=quantization(q),
        quantum_tau=None if tau is None else quantization(tau),
        noise_q=_sigma(q),
        noise_tau=sigma_tau,
        excitation=excitation(*motion, noise_tau=used),
    )


def _sigma(values: np.ndarray) -> float:
    """Estimate the noise of one signal (n,), 1 sigma; 0 if there are too few readings."""
    return float(highpass_sigma(values[:, None])[0])


def _missing(rec: Recording, q: np.ndarray) -> tuple[float, float]:
    """Return the share of missing readings, and the longest time between two readings with missing ones between, s."""
    bad = np.isnan(q)
    if not bad.any():
        return 0.0, 0.0
    new = np.concatenate([[True], ~within_episode(rec)])
    longest = 0.0
    for rows in np.split(np.arange(len(q)), np.flatnonzero(new)[1:]):
        good = rows[~bad[rows]]
        ends = np.unique(np.concatenate([rows[:1], good, rows[-1:]]))
        gaps = np.diff(ends) > 1
        if gaps.any():
            longest = max(longest, float(np.diff(rec.time[ends])[gaps].max()))
    return float(bad.mean()), longest
