"""The columns of samples.csv and samples.parquet, and what each control mode needs."""

from __future__ import annotations

from collections.abc import Sequence

JOINT_SIGNALS = ("q", "dq", "tau", "tau_cmd", "q_cmd", "dq_cmd", "load")  # one column a joint: `q.joint1`
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
SPATIAL_SIGNALS = {"ee": POSE, "ee_cmd": POSE, "ft": WRENCH}
SIGNALS = (*JOINT_SIGNALS, *SPATIAL_SIGNALS)
NEEDED = {  # control mode -> commands that a simulation of the recording needs
    "torque": ("tau_cmd",),
    "position": ("q_cmd",),
    "osc": ("ee_cmd",),
    "servo": ("q_cmd",),
    "passive": (),
    "unknown": (),
}


def columns_of(signal: str, joints: Sequence[str]) -> list[str]:
    """Return the column names of a signal, in order: `q` -> q.joint1, q.joint2, ...; `ee` -> ee.x ... ee.qz."""
    return [f"{signal}.{tail}" for tail in SPATIAL_SIGNALS.get(signal, joints)]
