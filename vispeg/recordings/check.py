"""Checks a recording before anybody fits to it: clock, limits, saturation, noise, excitation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vispeg.recordings.differentiate import smooth
from vispeg.recordings.excitation import Excitation, excitation
from vispeg.recordings.noise import highpass_sigma
from vispeg.recordings.quality import Limits, quantization, saturated
from vispeg.recordings.recording import Recording
from vispeg.recordings.timing import Timing, timing, within_episode

SMOOTHING_HZ = 20.0
OVER_ANGLE, OVER_SPEED, OVER_TORQUE = 1e-3, 1.02, 1.02  # rad; factors: beyond what noise can do
SILENT_Q, SILENT_TAU = 1e-7, 1e-5  # rad; share of the peak torque: no sensor is as quiet as this
FLAT = 0.02  # least share of its own that a parameter's column needs to be told from the others


@dataclass(frozen=True)
class JointCheck:
    """One joint of a recording. SI units, radians; None where there is no such signal.

    Attributes:
        name: the joint.
        missing: share of its angle readings that are missing.
        longest_missing_s: the longest stretch without one.
        low, high: extremes of the angle.
        peak_torque: largest measured torque.
        outside_range, over_velocity, over_torque: number of rows beyond the robot's limits.
        saturated: signal (`tau`, `tau_cmd`) -> number of clipped rows, those above zero only.
        quantum_q, quantum_tau: quantization step where one is seen.
        noise_q, noise_tau: 1-sigma estimated from fourth differences.
        excitation: how it was moved; without `sigma` where the torque shows no noise and none is stated.
    """

    name: str
    missing: float
    longest_missing_s: float
    low: float
    high: float
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


@dataclass(frozen=True)
class CheckReport:
    """What `check` found; `warnings` are sentences for a person."""

    recording: str
    robot: str
    mode: str
    motion: str
    rows: int
    timing: Timing
    joints: tuple[JointCheck, ...]
    warnings: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data for JSON; what is not finite becomes None."""
        return _finite(asdict(self))


def check(rec: Recording, limits: Limits | None = None) -> CheckReport:
    """Examines a recording.

    Args:
        rec: the recording.
        limits: the robot's limits in the order of `rec.joints`, or None where they are not known.
    """
    clock = timing(rec)
    cutoff = min(SMOOTHING_HZ, 0.2 * clock.rate_hz)
    motion = smooth(rec.time, rec.q, cutoff)
    joints = tuple(_joint(rec, j, motion, clock, limits) for j in range(len(rec.joints)))
    return CheckReport(
        recording=str(rec.path),
        robot=rec.robot,
        mode=rec.control.mode,
        motion=rec.motion,
        rows=len(rec.time),
        timing=clock,
        joints=joints,
        warnings=tuple(
            _clock_warnings(clock)
            + _silence_warnings(joints, rec)
            + [line for joint in joints for line in _joint_warnings(joint, rec)]
        ),
    )


def _joint(rec: Recording, j: int, motion: tuple[np.ndarray, ...], clock: Timing, limits: Limits | None) -> JointCheck:
    q, speed = rec.q[:, j], np.abs(motion[1][:, j])
    tau = None if rec.tau is None else rec.tau[:, j]
    dt = 1.0 / clock.rate_hz
    low, high = limits.range[j] if limits else (-np.inf, np.inf)
    top_speed, top_torque = (limits.velocity[j], limits.torque[j]) if limits else (np.inf, np.inf)
    torques = {name: v[:, j] for name in ("tau", "tau_cmd") if (v := getattr(rec, name)) is not None}
    clipped = {name: int(saturated(values, dt, float(top_torque)).sum()) for name, values in torques.items()}
    sigma_tau = None if tau is None else _sigma(tau)
    peak_tau = None if tau is None or np.isnan(tau).all() else float(np.nanmax(np.abs(tau)))
    used = float(rec.noise["tau"]) if tau is not None and "tau" in rec.noise else sigma_tau
    if "tau" not in rec.noise and _silent(sigma_tau, peak_tau):
        used = None  # what is left of a filtered signal's noise says nothing about how well a parameter is known
    missing, longest = _missing(rec, q)
    return JointCheck(
        name=rec.joints[j],
        missing=missing,
        longest_missing_s=longest,
        low=float(np.nanmin(q)),
        high=float(np.nanmax(q)),
        peak_torque=peak_tau,
        outside_range=int(np.sum((q < low - OVER_ANGLE) | (q > high + OVER_ANGLE))),
        over_velocity=int(np.sum(speed > OVER_SPEED * top_speed)),
        over_torque=0 if tau is None else int(np.sum(np.abs(tau) > OVER_TORQUE * top_torque)),
        saturated={name: count for name, count in clipped.items() if count},
        quantum_q=quantization(q),
        quantum_tau=None if tau is None else quantization(tau),
        noise_q=_sigma(q),
        noise_tau=sigma_tau,
        excitation=excitation(*(part[:, j] for part in motion), noise_tau=used),  # type: ignore[misc]
    )


def _sigma(values: np.ndarray) -> float:
    """Noise of one signal (n,); 0 where there are too few readings to tell."""
    diff = np.diff(values, 4)
    return float(highpass_sigma(values[:, None])[0]) if np.isfinite(diff).any() else 0.0


def _missing(rec: Recording, q: np.ndarray) -> tuple[float, float]:
    """Share of missing readings, and the longest stretch between two that exist, s, if any is missing in it."""
    bad = np.isnan(q)
    if not bad.any():
        return 0.0, 0.0
    new = np.concatenate([[True], ~within_episode(rec)])
    longest = 0.0
    for rows in np.split(np.arange(len(q)), np.flatnonzero(new)[1:]):
        good = rows[~bad[rows]]
        marks = rec.time[np.unique(np.concatenate([rows[:1], good, rows[-1:]]))]
        at = np.unique(np.concatenate([rows[:1], good, rows[-1:]]))
        skips = np.diff(at) > 1
        if skips.any():
            longest = max(longest, float(np.diff(marks)[skips].max()))
    return float(bad.mean()), longest


def _clock_warnings(clock: Timing) -> list[str]:
    out = []
    if abs(clock.rate_hz / clock.stated_hz - 1) > 0.02:
        out.append(f"samples come at {clock.rate_hz:.4g} Hz, recording.yaml says {clock.stated_hz:.4g} Hz")
    if clock.jitter * clock.rate_hz > 0.1:
        out.append(f"the sample period jitters by {1e3 * clock.jitter:.3g} ms RMS ({clock.jitter * clock.rate_hz:.0%})")
    if clock.gaps:
        lost = sum(gap.samples for gap in clock.gaps)
        worst = max(clock.gaps, key=lambda gap: gap.seconds)
        where = f"the longest, {1e3 * worst.seconds:.0f} ms, at {worst.start:.3f} s"
        out.append(f"{len(clock.gaps)} gaps, {lost} samples lost; {where}")
    if clock.repeated:
        out.append(f"{clock.repeated} rows repeat the one before bit for bit: readings were dropped and held")
    if clock.zeroed:
        out.append(f"{clock.zeroed} rows have every angle at exactly zero: missing readings should be empty cells")
    return out


def _silent(sigma: float | None, peak: float | None) -> bool:
    return sigma is not None and peak is not None and sigma < SILENT_TAU * peak


def _silence_warnings(joints: tuple[JointCheck, ...], rec: Recording) -> list[str]:
    quiet = {
        "q": [joint.name for joint in joints if joint.noise_q < SILENT_Q],
        "tau": [joint.name for joint in joints if _silent(joint.noise_tau, joint.peak_torque)],
    }
    out = []
    for signal, names in quiet.items():
        if names and signal not in rec.noise:
            whose = "every joint" if len(names) == len(joints) else ", ".join(names)
            why = "filtered before it was recorded, or simulated"
            out.append(f"{signal} of {whose} shows no sensor noise ({why}): state `noise.{signal}` in recording.yaml")
    return out


def _joint_warnings(joint: JointCheck, rec: Recording) -> list[str]:
    out, motion = [], joint.excitation
    if joint.missing:
        out.append(
            f"{joint.missing:.1%} of the angles are missing, up to {1e3 * joint.longest_missing_s:.0f} ms in a row"
        )
    for count, what in (
        (joint.outside_range, "outside the joint's range"),
        (joint.over_velocity, "above the velocity limit"),
        (joint.over_torque, "above the torque limit"),
    ):
        if count:
            out.append(f"{count} rows are {what}")
    out += [f"{name} is saturated in {count} rows" for name, count in joint.saturated.items()]
    if joint.quantum_q is not None and joint.quantum_q > 1e-4:
        out.append(f"the angle comes in steps of {joint.quantum_q:.2g} rad")
    for name, estimate in (("q", joint.noise_q), ("tau", joint.noise_tau)):
        stated = rec.noise.get(name)
        if stated and estimate and not 1 / 3 < estimate / stated < 3:
            out.append(f"noise of {name} looks like {estimate:.2g}, recording.yaml says {stated:.2g}")
    if motion.condition is None:
        out.append("does not move enough to tell anything about it")
    else:
        if motion.reversals < 2:
            out.append(f"reverses {motion.reversals} times: dry friction cannot be told from a constant torque")
        weak = [name for name, own in motion.identifiability.items() if own < FLAT]
        if weak:
            out.append(f"this motion alone cannot separate {', '.join(weak)}")
    return [f"{joint.name}: {line}" for line in out]


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
