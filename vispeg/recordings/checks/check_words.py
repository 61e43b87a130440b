"""Word the warnings that `vispeg check` prints about a recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.counts import count
from vispeg.recordings.checks.joint_check import JointCheck
from vispeg.recordings.checks.missing import said
from vispeg.recordings.checks.spikes import Spike
from vispeg.recordings.checks.timing import Timing
from vispeg.recordings.importers.slopes import Doubt
from vispeg.recordings.noise import silent
from vispeg.recordings.recording import Recording

SILENT_Q = 1e-7  # rad: real encoders are noisier
FLAT = 0.02  # least share of a regressor column not explained by the others, for its parameter to be identifiable
POOR_TRACKING = 2.0  # degrees RMS: a larger tracking error suggests a wrong actuator model


def warnings_of(rec: Recording, clock: Timing, joints: Sequence[JointCheck], doubts: Sequence[Doubt] = ()) -> list[str]:
    """Return warnings about impossible units, the clock, sensors without noise, and each joint."""
    each = [line for joint in joints for line in _joint_warnings(joint, rec)]
    units = [doubt.line for doubt in doubts]
    return units + said(rec) + _clock_warnings(clock) + _silence_warnings(joints, rec) + each


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
        out.append(f"{count(len(clock.gaps), 'gap')}, {count(lost, 'sample')} lost; {where}")
    if clock.repeated:
        out.append(f"{count(clock.repeated, 'row')} with the angles of the one before, bit for bit: readings were held")
    if clock.zeroed:
        out.append(
            f"{count(clock.zeroed, 'row')} with every angle at exactly zero: missing readings should be empty cells"
        )
    return out


def _spike_words(bad: Sequence[Spike]) -> str:
    worst = max(bad, key=lambda spike: abs(spike.size))
    many = f"{len(bad)} readings jump" if len(bad) > 1 else "one reading jumps"
    largest = ", the largest" if len(bad) > 1 else ""
    where = f"{worst.size:+.3g} rad at {worst.time:.6g} s (sample {worst.row + 1})"
    return f"{many} away and back{largest} by {where}: bad; left out, and best left empty in the file"


def _silence_warnings(joints: Sequence[JointCheck], rec: Recording) -> list[str]:
    quiet = {
        "q": [joint.name for joint in joints if joint.noise_q < SILENT_Q and joint.quantum_q is None],
        "tau": [joint.name for joint in joints if silent(joint.noise_tau, joint.peak_torque)],
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
    if joint.spikes:
        out.append(_spike_words(joint.spikes))
    for rows, what in (
        (joint.outside_range, "outside the joint's range"),
        (joint.over_velocity, "above the velocity limit"),
        (joint.over_torque, "above the torque limit"),
    ):
        if rows:
            out.append(f"{count(rows, 'row')} {what}")
    if joint.tracking_rms is not None and np.degrees(joint.tracking_rms) > POOR_TRACKING:
        rms, worst = np.degrees(joint.tracking_rms), np.degrees(joint.tracking_worst or 0.0)
        out.append(
            f"is off its command by {rms:.1f} degrees RMS, {worst:.1f} at most: beyond 2 to 3 degrees a simulation's "
            "model of the actuator is the first suspect"
        )
    out += [f"{name} is saturated in {count(rows, 'row')}" for name, rows in joint.saturated.items()]
    if joint.quantum_q is not None and joint.quantum_q > 1e-4:
        out.append(f"the angle comes in steps of {joint.quantum_q:.2g} rad")
    for name, estimate in (("q", joint.noise_q), ("tau", joint.noise_tau)):
        stated = rec.noise.get(name)
        if stated and estimate and not 1 / 3 < estimate / stated < 3:
            out.append(f"noise of {name} looks like {estimate:.2g}, recording.yaml says {stated:.2g}")
    if motion.condition is None:
        out.append("does not move enough to identify anything")
    else:
        if motion.reversals < 2:
            out.append(
                f"reverses {motion.reversals} times: dry friction cannot be distinguished from a constant torque"
            )
        weak = [name for name, share in motion.identifiability.items() if share < FLAT]
        if weak:
            out.append(f"this motion alone cannot separate {', '.join(weak)}")
    return [f"{joint.name}: {line}" for line in out]
