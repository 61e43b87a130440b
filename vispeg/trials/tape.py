"""Collect an episode's readings and policy steps, and turn them into a trial."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vispeg.interface.builder import Picture
from vispeg.interface.interface import Interface
from vispeg.recordings.cell import CellBelief, WrenchSensor, reaction
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.recording import Control, Nullspace, Recording
from vispeg.render.cameras.camera import Camera
from vispeg.render.image_kinds import camera_of
from vispeg.trials.trial import Steps

DEPTH_UNIT = 1e-4  # m: 16 bits reach 6.5 m, at a tenth of a depth camera's resolution


class Tape:
    """Collect one episode.

    Args:
        interface: the policy's interface, which describes the arm and its controller.
        felt: whether the robot measures forces.
    """

    def __init__(self, interface: Interface, felt: bool = True):
        self.interface, self.felt = interface, felt
        self._ticks: list[tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        self._steps: list[tuple[float, float, np.ndarray, np.ndarray, np.ndarray]] = []
        self._pictures: list[tuple[float, str, Picture]] = []
        self._cameras: dict[str, Camera] = {camera_of(key): seen.eye for key, seen in interface.images.items()}

    def tick(self, time: float, q: np.ndarray, dq: np.ndarray, wrench: np.ndarray, target: np.ndarray) -> None:
        """Add a reading, unless its time is not later than the last one's.

        Args:
            time: time on the robot's clock, s.
            q, dq: (nj,) joint angles, rad, and velocities, rad/s.
            wrench: (6,) wrench of the tool on the flange, in flange axes, N and N m.
            target: (7,) commanded flange pose.
        """
        if not self._ticks or time > self._ticks[-1][0]:
            read = np.array(q, float), np.array(dq, float), np.array(wrench, float), np.array(target, float)
            self._ticks.append((time, *read))

    def step(
        self,
        late: float,
        seen: np.ndarray,
        action: np.ndarray,
        target: np.ndarray,
        pictures: Mapping[str, Picture],
        moves: bool = True,
    ) -> None:
        """Add a policy step on the last reading; with `moves`, the reading's commanded pose becomes `target`."""
        time, q, dq, wrench, before = self._ticks[-1]
        self._ticks[-1] = (time, q, dq, wrench, np.array(target, float) if moves else before)
        seen, action, target = (np.array(x, float).reshape(-1) for x in (seen, action, target))
        self._steps.append((time, late, seen, action, target))
        self._pictures += [(time, name, picture) for name, picture in pictures.items()]

    @property
    def late(self) -> np.ndarray:
        """Delay (n,) of each step's command, s."""
        return np.array([s[1] for s in self._steps])

    @property
    def length(self) -> float:
        """Time between the first and the last reading, on the robot's clock, s."""
        return self._ticks[-1][0] - self._ticks[0][0] if self._ticks else 0.0

    @property
    def begun(self) -> float:
        """Time between the first reading and the policy's first step, s."""
        return self._steps[0][0] - self._ticks[0][0] if self._steps else 0.0

    def steps(self) -> Steps:
        """Return the policy's observations and actions."""
        columns = [np.array(column) for column in zip(*self._steps, strict=True)]
        time, *rest = columns
        return Steps(time - self._ticks[0][0], *rest)

    def recording(self, notes: str = "") -> Recording:
        """Return all readings and pictures as a recording that begins at 0 s."""
        i = self.interface
        time, q, dq, wrench, target = (np.array(column) for column in zip(*self._ticks, strict=True))
        pos, turn, _, _ = i.chain.pose(q, dq)
        null = i.controller.nullspace
        limit = np.array(i.arm.torque_limit)
        control = Control(
            "osc",
            1.0 / i.controller.period_s,
            "model",
            np.array(i.controller.kp),
            np.array(i.controller.kd),
            Nullspace(float(null["kp"]), float(null["kd"]), np.array(null["q"], float)),
            i.controller.force_limit_n,
            limit if np.isfinite(limit).all() else None,
        )
        tool = i.tool
        return Recording(
            path=Path("trial"),
            robot=i.arm.robot,
            joints=i.arm.joints,
            rate_hz=1.0 / i.controller.period_s,
            control=control,
            time=time - time[0],
            q=q,
            dq=dq,
            ee=np.concatenate([pos, turn], axis=1),
            ee_cmd=target,
            ft=reaction(wrench) if self.felt else None,
            tool={
                "mass_kg": tool.mass_kg,
                "com_m": list(tool.com_m),
                "inertia_kgm2": list(tool.inertia_kgm2),
                "name": tool.name,
            },
            cell=CellBelief("", dict(i.goal.cell)) if i.goal.cell else None,
            wrench=WrenchSensor() if self.felt else None,
            motion="policy",
            notes=notes,
            frames=self._frames(time[0]),
        )

    def _frames(self, begin: float) -> Frames | None:
        cameras: dict[str, RecordedCamera] = {}
        frames = []
        for time, name, picture in self._pictures:
            if name not in cameras:
                cameras[name] = recorded(picture.camera or self._cameras[name], name)
            depth = None if picture.depth is None else np.nan_to_num(np.asarray(picture.depth, np.float32))
            frames.append(RecordedFrame(time - begin, cameras[name], picture.rgb, depth))
        return Frames(cameras, tuple(frames)) if frames else None


def recorded(camera: Camera, name: str) -> RecordedCamera:
    """Return a camera in a recording's form; without a pose unless it is mounted on the flange or the base."""
    c, mount, pose = camera, None, None
    if c.parent in ("base", "flange"):
        mount, pose = c.parent, np.eye(4)
        pose[:3, :3], pose[:3, 3] = c.rotation, c.pos
    k1, k2, p1, p2, k3 = c.distortion
    return RecordedCamera(
        name, c.width, c.height, c.fx, c.fy, c.cx, c.cy, (k1, k2, p1, p2, k3), DEPTH_UNIT, mount, pose
    )
