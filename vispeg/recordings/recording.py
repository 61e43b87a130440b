"""A recording in memory: the measured signals, and how they were measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vispeg.core.counts import count
from vispeg.recordings.cell import CellBelief, Outcome, WrenchSensor
from vispeg.recordings.columns import JOINT_SIGNALS, SIGNALS
from vispeg.recordings.frames.frames import Frames

Mode = Literal["torque", "position", "osc", "servo", "passive", "unknown"]


@dataclass(frozen=True)
class Nullspace:
    """OSC posture task: kp 1/s^2, kd 1/s, q (nj,) rad."""

    kp: float
    kd: float
    q: np.ndarray


@dataclass(frozen=True)
class Control:
    """The controller that ran on the robot, see docs/formats.md; gains are arrays, one per joint or six for osc."""

    mode: Mode = "unknown"
    rate_hz: float = 500.0
    gravity_compensation: Literal["model", "none"] = "none"
    kp: np.ndarray | None = None
    kd: np.ndarray | None = None
    nullspace: Nullspace | None = None
    force_limit: float | None = None  # N, osc: the greatest commanded force
    torque_limit: np.ndarray | None = None  # (nj,) N m, osc: limit at which the commanded torque is clipped


@dataclass(frozen=True)
class Window:
    """A stretch of a recording, on its clock (`Recording.elapsed`), s."""

    start: float
    stop: float


@dataclass(frozen=True)
class Chosen:
    """The windows that were chosen from a long recording.

    Attributes:
        of_s, used_s: length of the recording and of the used part, s.
        windows: in order of time.
        reversals, reversals_of: changes of direction in the windows and in the whole recording, summed over joints.
        speed, acceleration, load: peak in the windows over peak in the whole recording, for the joint with the least
            such ratio.
        standing: joints that move in the recording but in none of the windows.
    """

    of_s: float
    used_s: float
    windows: tuple[Window, ...]
    reversals: int
    reversals_of: int
    speed: float
    acceleration: float
    load: float
    standing: tuple[str, ...] = ()

    def said(self, name: str) -> str:
        """Describe the choice in one sentence."""
        where = ", ".join(f"{w.start:.4g}" for w in self.windows)
        count = f"{len(self.windows)} windows" if len(self.windows) > 1 else "one window"
        speed, acceleration, load = (f"{100 * x:.0f} %" for x in (self.speed, self.acceleration, self.load))
        moves = "moves" if len(self.standing) == 1 else "move"
        standing = (
            f"; {', '.join(self.standing)} {moves} in none of them: use more (--seconds)" if self.standing else ""
        )
        return (
            f"{name}: {self.used_s:.0f} of {self.of_s:.0f} s are used, {count} from {where} s on, chosen for what they "
            f"show: {self.reversals} of {self.reversals_of} reversals, and of every joint at least {speed} of its top "
            f"speed, {acceleration} of its acceleration, {load} of its range of load{standing}"
        )


@dataclass(frozen=True)
class Signal:
    """A measured signal of a user-defined channel, one column per joint.

    Attributes:
        values: (n, nj) in `unit`, NaN where a reading is missing.
        unit: as the header states it.
        noise: 1-sigma, or None if not stated.
    """

    values: np.ndarray
    unit: str
    noise: float | None = None


@dataclass(frozen=True)
class Recording:
    """One folder in the format that docs/formats.md states.

    Attributes:
        path: the folder (or a label where there is none).
        robot: name, or an absolute path to the MJCF/URDF beside the recording.
        joints: joint names, (nj,).
        rate_hz: nominal sample rate.
        control: the controller.
        time: (n,) s.
        q: (n, nj) rad, measured; NaN where a reading is missing, here and in every array below.
        dq, tau, tau_cmd, q_cmd, dq_cmd: (n, nj) or None.
        load: (n, nj) or None; the robot's own estimate of its motors' torque, in any unit, with or without a sign.
        ee, ee_cmd: (n, 7) x y z qw qx qy qz of the flange in the base, or None.
        ft: (n, 6) N, N m, or None; `wrench` states its convention.
        episode: (n,) int; rows of one episode belong together.
        tool: None, or {mass_kg, com_m, inertia_kgm2, name}.
        base_tilt: (2,) rad, believed roll and pitch of the base.
        torque_sensor: what `tau` measures.
        noise: 1-sigma per channel (`q`, `dq`, `tau`, `ee`, `ft` in N, `ft_torque` in N m), only what is known.
        cell: the user's belief about the cell; None if not stated.
        wrench: the convention of the wrist's wrench sensor; None if not stated.
        outcomes: outcomes of trials, for the episodes that state one.
        motion, notes: free text.
        signals: name -> further signal measured in every joint, as the header declares it.
        frames: pictures, or None if there are none.
        chosen: the windows of a longer recording that this one consists of (`recordings.windows`), or None if whole.
        compared: (n,) bool, the samples at which a model is compared with it; the others are simulated all the same.
            None for all of them.
        bad: (n, nj) bool, readings of the angles that were left out of `q` as outliers (`checks.spikes`), or None.
        held: (n,) bool, samples whose angles repeat an earlier reading, with which models are not compared, or None.
        clock: (n,) s, `elapsed` of a part of a recording, whose clock began before it; None for a whole one.
    """

    path: Path
    robot: str
    joints: tuple[str, ...]
    rate_hz: float
    control: Control
    time: np.ndarray
    q: np.ndarray
    dq: np.ndarray | None = None
    tau: np.ndarray | None = None
    tau_cmd: np.ndarray | None = None
    q_cmd: np.ndarray | None = None
    dq_cmd: np.ndarray | None = None
    load: np.ndarray | None = None
    ee: np.ndarray | None = None
    ee_cmd: np.ndarray | None = None
    ft: np.ndarray | None = None
    episode: np.ndarray | None = None
    tool: Mapping[str, Any] | None = None
    base_tilt: tuple[float, float] = (0.0, 0.0)
    torque_sensor: Literal["joint", "motor", "none"] = "none"
    noise: Mapping[str, float] = field(default_factory=dict)
    cell: CellBelief | None = None
    wrench: WrenchSensor | None = None
    outcomes: tuple[Outcome, ...] = ()
    motion: str = ""
    notes: str = ""
    signals: Mapping[str, Signal] = field(default_factory=dict)
    frames: Frames | None = None
    chosen: Chosen | None = None
    compared: np.ndarray | None = None
    bad: np.ndarray | None = None
    held: np.ndarray | None = None
    clock: np.ndarray | None = None

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.path.name

    @property
    def elapsed(self) -> np.ndarray:
        """Time on the recording's clock (n,) s: since its first sample, whatever `time` counts from.

        The clock goes on from one episode to the next, and begins anew with an episode whose times go back.
        """
        if self.clock is not None:
            return self.clock
        first = np.flatnonzero(np.diff(self.time, prepend=np.inf) <= 0)  # the first sample, and those after a step back
        return self.time - np.repeat(self.time[first], np.diff(first, append=len(self.time)))

    def some(self, rows: Any) -> Recording:
        """Select samples by the index `rows`; all frames are kept."""
        names = ("time", "episode", "compared", "bad", "held", *SIGNALS)
        columns = {k: v[rows] for k in names if (v := getattr(self, k)) is not None}
        signals = {k: replace(s, values=s.values[rows]) for k, s in self.signals.items()}
        return replace(self, signals=signals, clock=self.elapsed[rows], **columns)

    def __repr__(self) -> str:
        arrays = [
            key for key, value in vars(self).items() if isinstance(value, np.ndarray) and key not in ("time", "clock")
        ]
        size = f"{count(len(self.joints), 'joint')}, {count(len(self.time), 'sample')}"
        summary = f"{self.robot}, {size} at {self.rate_hz:g} Hz"
        pictures = "" if self.frames is None else f" and {count(len(self.frames), 'picture')}"
        return f"<Recording {self.name}: {summary}: {', '.join(arrays)}{pictures}>"


def in_order(rec: Recording, joints: Sequence[str]) -> Recording:
    """Reorder a recording's joints to the robot's order `joints`; unchanged if the robot lacks one of them."""
    wanted = tuple(joint for joint in joints if joint in rec.joints)
    if wanted == rec.joints or len(wanted) != len(rec.joints):
        return rec
    order = [rec.joints.index(joint) for joint in wanted]
    signals = {name: value[:, order] for name in (*JOINT_SIGNALS, "bad") if (value := getattr(rec, name)) is not None}
    control = rec.control
    if control.mode == "position" and control.kp is not None and control.kd is not None:
        control = replace(control, kp=control.kp[order], kd=control.kd[order])
    if control.torque_limit is not None:
        control = replace(control, torque_limit=control.torque_limit[order])
    if control.nullspace is not None:
        control = replace(control, nullspace=replace(control.nullspace, q=control.nullspace.q[order]))
    declared = {name: replace(s, values=s.values[:, order]) for name, s in rec.signals.items()}
    return replace(rec, joints=wanted, control=control, signals=declared, **signals)
