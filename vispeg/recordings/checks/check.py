"""Check a recording before a fit: clock, bad readings, limits, tracking, noise, excitation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vispeg.recordings.checks.check_words import warnings_of
from vispeg.recordings.checks.contact_check import ContactCheck
from vispeg.recordings.checks.joint_check import JointCheck, joint_check
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.checks.timing import Timing, timing
from vispeg.recordings.importers.fits import Needs
from vispeg.recordings.importers.plausible import doubts
from vispeg.recordings.recording import Recording

SIGNALS = ("dq", "tau", "tau_cmd", "q_cmd")  # signals checked in addition to q


@dataclass(frozen=True)
class CheckReport:
    """Results of `check`; `warnings` are sentences for the user, `contact` is None without a contact check."""

    recording: str
    robot: str
    mode: str
    motion: str
    rows: int
    timing: Timing
    joints: tuple[JointCheck, ...]
    warnings: tuple[str, ...]
    contact: ContactCheck | None = None

    def to_json(self) -> Mapping[str, object]:
        """Return plain data for JSON, with None for numbers that are not finite."""
        return _finite(asdict(self))


def check(
    rec: Recording,
    limits: Limits | None = None,
    progress: Callable[[float], None] = lambda share: None,
    needs: Needs | None = None,
) -> CheckReport:
    """Check a recording joint by joint, so that the check of a long one needs little extra memory.

    Args:
        rec: the recording.
        limits: the robot's limits in the order of `rec.joints`, or None where they are not known.
        progress: called with the share of the joints that has been examined.
        needs: torques of the robot's model for a motion, or None where that is not known.
    """
    clock, joints = timing(rec), []
    for j in range(len(rec.joints)):
        joints.append(joint_check(rec, j, clock, limits))
        progress(len(joints) / len(rec.joints))
    return CheckReport(
        recording=str(rec.path),
        robot=rec.robot,
        mode=rec.control.mode,
        motion=rec.motion,
        rows=len(rec.time),
        timing=clock,
        joints=tuple(joints),
        warnings=tuple(warnings_of(rec, clock, joints, doubts(rec, limits, needs=needs) if limits else ())),
    )


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
