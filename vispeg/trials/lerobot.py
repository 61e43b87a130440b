"""The driver for arms supported by LeRobot: `--robot lerobot:TYPE`, or `lerobot:TYPE:FILE.yaml` (docs/run.md).

LeRobot's `Robot` returns joint positions and camera pictures and accepts joint angles; it has no time stamps,
velocities or wrench. So readings are time-stamped on arrival, velocities are estimated from recent angles, and the
commanded flange pose is converted to joint angles here. Nothing is sent before the policy's first command.
"""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from vispeg.core.errors import UserError
from vispeg.formats.typed import typed
from vispeg.formats.yaml_data import read_yaml
from vispeg.interface.builder import Picture
from vispeg.interface.interface import Interface
from vispeg.interface.lerobot import PREFIX, LeRobotProcess
from vispeg.render.cameras.camera import Camera
from vispeg.render.image_kinds import RGB, camera_of, kind_of
from vispeg.trials.driver import Connected, Reading
from vispeg.trials.joint_goals import JointGoals

WAIT = 5.0  # s, timeout of an answer; a motor bus or a camera normally takes some hundredths of a second
LEAVE = 5.0  # s, timeout for disconnecting from the arm
BLIND = 0.5  # s, longest time without a picture; cameras are slower than joints
FRAMES = 30.0  # Hz, rate at which pictures are requested; most cameras deliver this rate
SILENCE = 0.25  # s, longest time without a reading, as in the run loop
POSITION = ".pos"  # suffix of a motor's name for its position

Name = Annotated[str, Field(min_length=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Above0 = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class MotorPart(_Part):
    """The motor of a joint, and how to read its position: by default the motor of the joint's name, in degrees.

    Attributes:
        motor: name of the motor; None for the joint's name.
        unit: `deg`, `rad`, or `percent` for LeRobot's normalized positions, -100 to 100 over `range_rad`.
        sign: direction of the motor relative to the joint.
        zero_rad: joint angle at motor position 0, rad.
        range_rad: joint angles at -100 and at 100, rad; given exactly if the unit is `percent`.
    """

    motor: Name | None = None
    unit: Literal["deg", "rad", "percent"] = "deg"
    sign: Literal[1, -1] = 1
    zero_rad: Finite = 0.0
    range_rad: tuple[Finite, Finite] | None = None

    @model_validator(mode="after")
    def _complete(self) -> MotorPart:
        if (self.unit == "percent") != (self.range_rad is not None):
            raise ValueError("unit: percent and range_rad, the angles at -100 and 100, must be given together")
        if self.range_rad is not None and (self.sign, self.zero_rad) != (1, 0.0):
            raise ValueError("range_rad determines sign and zero_rad, so give neither of them")
        if self.range_rad is not None and self.range_rad[0] == self.range_rad[1]:
            raise ValueError("range_rad has zero width")
        return self

    @property
    def line(self) -> tuple[float, float]:
        """Slope a and intercept b, rad, of the joint angle a x + b at motor position x, in the motor's unit."""
        if self.range_rad is not None:
            low, high = self.range_rad
            return (high - low) / 200.0, (high + low) / 2.0
        return self.sign * (np.pi / 180.0 if self.unit == "deg" else 1.0), self.zero_rad


class CameraPart(_Part):
    """A camera: LeRobot's name for it, and its lens, in px and Brown's five coefficients.

    Without a lens, the camera is taken to be identical to the one that the policy was trained with.
    """

    key: Name | None = None
    fx: Above0 | None = None
    fy: Above0 | None = None
    cx: Finite | None = None
    cy: Finite | None = None
    distortion: Annotated[tuple[Finite, ...], Field(min_length=5, max_length=5)] = (0.0,) * 5

    @model_validator(mode="after")
    def _complete(self) -> CameraPart:
        if len({value is None for value in (self.fx, self.fy, self.cx, self.cy)}) > 1:
            raise ValueError("fx, fy, cx, cy must be given together")
        return self


class Wiring(_Part):
    """Content of the file in `lerobot:TYPE:FILE.yaml`; without a file, the defaults hold.

    Attributes:
        config: fields of LeRobot's configuration for this type of robot, such as `port`, `id`, `cameras`.
        joints: joint name in the model -> motor.
        cameras: camera name of the policy -> camera.
        rate_hz: highest rate at which the arm is read and commanded, Hz; None for the policy's control rate.
        velocity_window_s: window over which velocities are estimated as the slope of the angles, s.
    """

    config: dict[str, Any] = {}
    joints: dict[str, MotorPart] = {}
    cameras: dict[str, CameraPart] = {}
    rate_hz: Annotated[float, Field(ge=10, le=1000)] | None = None
    velocity_window_s: Annotated[float, Field(ge=0.01, le=0.5)] = 0.06


def read_wiring(file: str | Path) -> Wiring:
    """Read a file on motors and cameras.

    Raises:
        UserError: no such file, invalid YAML, an unknown key or an impossible value.
    """
    return typed(Wiring, read_yaml(file) or {}, file)


class Motors:
    """Convert between joint angles and the motor values of a robot.

    Args:
        wiring: motor and unit of each joint.
        joints: joint names of the arm.
        state: names of the values that the robot reports.
        action: names of the values that the robot accepts.
        file: the file of `wiring`, for error messages.

    Attributes:
        slope, zero: (nj,) joint angle = slope * motor position + zero, rad.
        read, sent: (nj,) index of each joint's motor among the reported and the accepted values.
        both: (index among the accepted values, index among the reported values) of every value that is in both.
        unknown: accepted values that are not reported; `action` requires that there are none.

    Raises:
        UserError: an unknown joint or motor, or one motor for two joints.
    """

    def __init__(
        self, wiring: Wiring, joints: Sequence[str], state: Sequence[str], action: Sequence[str], file: str | None
    ):
        for name in wiring.joints:
            if name not in joints:
                raise UserError("no joint of the arm", file=file, key=f"joints.{name}", expected=", ".join(joints))
        parts = [wiring.joints.get(name, MotorPart()) for name in joints]
        names = [(part.motor or joint) + POSITION for part, joint in zip(parts, joints, strict=True)]
        for joint, name in zip(joints, names, strict=True):
            if name not in state or name not in action:
                has = [key.removesuffix(POSITION) for key in state if key.endswith(POSITION) and key in action]
                expected = f"one of {', '.join(has) or 'none'}; joints.{joint}.motor of a FILE.yaml says which"
                got = name.removesuffix(POSITION)
                raise UserError(f"the robot has no such motor for {joint}", file=file, expected=expected, got=got)
            if names.count(name) > 1:
                raise UserError(
                    "two joints name the same motor", file=file, key="joints", got=name.removesuffix(POSITION)
                )
        self.slope, self.zero = np.array([part.line for part in parts]).T
        self.read = np.array([list(state).index(name) for name in names])
        self.sent = np.array([list(action).index(name) for name in names])
        self.both = [(i, list(state).index(name)) for i, name in enumerate(action) if name in state]
        self.unknown = [name for name in action if name not in state]

    def angles(self, state: np.ndarray) -> np.ndarray:
        """Convert the robot's reported values (nstate,) to joint angles (nj,) rad."""
        return self.slope * state[self.read] + self.zero

    def action(self, q: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Convert angles (nj,) rad to the values to send (naction,).

        Motors without a joint keep the value that they have in `before`, reported values (nstate,).
        """
        out = np.zeros(len(self.both))
        for i, at in self.both:  # of all motors; the next line replaces those of the joints
            out[i] = before[at]
        out[self.sent] = (q - self.zero) / self.slope
        return out


class Slope:
    """Estimate joint velocities as the slope of a line fitted through the latest angles.

    One encoder step, 1.5 mrad for an STS3215, between two readings 5 ms apart would be 0.3 rad/s. With n readings in a
    window T, the standard deviation is that of the rounding of an angle times sqrt(12 / n) / T. The delay is T / 2.

    Args:
        window: length of the window, s.
    """

    def __init__(self, window: float):
        self.window, self._past = window, deque[tuple[float, np.ndarray]]()

    def add(self, time: float, q: np.ndarray) -> np.ndarray:
        """Add angles (nj,) rad at a time, s; return the velocities, rad/s, from at least the last two."""
        self._past.append((time, q))
        while len(self._past) > 2 and time - self._past[0][0] > self.window + 1e-9:
            self._past.popleft()
        if len(self._past) < 2:
            return np.zeros_like(q)
        at = np.array([t for t, _ in self._past])
        at -= at.mean()
        return at @ np.stack([angles for _, angles in self._past]) / (at @ at)


class LeRobotRobot:
    """Drive an arm that LeRobot supports.

    Args:
        text: TYPE, or TYPE:FILE.yaml.

    Raises:
        UserError: no installation of LeRobot is found, or the file is invalid.
    """

    def __init__(self, text: str):
        self.type, _, file = text.partition(":")
        self.file, self.wiring = file or None, read_wiring(file) if file else Wiring()
        config = json.dumps(self.wiring.config, default=str)
        self._link = LeRobotProcess(f"{PREFIX}{text}", "robot", self.type, config)
        self._thread: threading.Thread | None = None
        self._over, self._lock = threading.Event(), threading.Lock()
        self._newest: Reading | None = None
        self._seen: tuple[float, dict[str, Picture]] = -np.inf, {}  # the newest pictures, and when they were asked for
        self._goals: JointGoals | None = None  # None until the first command
        self._pose: np.ndarray | None = None
        self._why = ""  # the last error of the thread

    def connect(self, interface: Interface, seed: int) -> Connected:
        """See Driver. Raises UserError: LeRobot cannot connect, or a motor or camera does not exist."""
        if self._thread is None:
            self._open(interface)
        with self._lock:
            self._goals = self._pose = None
        return Connected(wrench=None)

    def _open(self, interface: Interface) -> None:
        """Start LeRobot's process, check motors and cameras, take a first reading, and start the thread."""
        if interface.feels:  # needs force or torque: the run loop will refuse the policy, so leave the arm alone
            return
        names = self._link.begin()
        state, action, cameras = ([str(x) for x in names[key]] for key in ("state", "action", "cameras"))
        self._motors = Motors(self.wiring, interface.arm.joints, state, action, self.file)
        if self._motors.unknown:
            what = "the robot accepts a value that it does not report, so it could not be held at its present value"
            raise UserError(what, key=f"{PREFIX}{self.type}", got=self._motors.unknown[0])
        self._eyes = self._cameras(interface, cameras)
        self._interface, self._slope = interface, Slope(self.wiring.velocity_window_s)
        self._tick(time.monotonic(), None)
        self._thread = threading.Thread(target=self._go, daemon=True)
        self._thread.start()

    def _cameras(self, interface: Interface, available: Sequence[str]) -> dict[str, tuple[str, Camera, CameraPart]]:
        """Return, by the policy's name of each camera: LeRobot's name, the camera of training, and its lens here."""
        out = {}
        for key, seen in interface.images.items():
            name = camera_of(key)
            if kind_of(key) is not RGB:
                raise UserError(
                    "LeRobot's robots deliver only colour pictures", key=key, expected="a policy that sees rgb"
                )
            part = self.wiring.cameras.get(name, CameraPart())
            lerobot_name = part.key or name
            if lerobot_name not in available:
                expected = f"one of {', '.join(available) or 'none'}; cameras.{name}.key of a FILE.yaml says which"
                what = f"the robot has no such camera for {name}"
                raise UserError(what, file=self.file, expected=expected, got=lerobot_name)
            out[name] = lerobot_name, seen.eye, part
        return out

    def _go(self) -> None:
        """Read and command the arm until the run ends."""
        period = 1.0 / self.wiring.rate_hz if self.wiring.rate_hz else self._interface.controller.period_s
        due = before = time.monotonic()
        while not self._over.is_set():
            due = max(due + period, time.monotonic() - period)
            self._over.wait(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            with self._lock:
                action = self._next(now - before)
            before = now
            try:
                self._tick(now, action)
            except UserError as error:  # a single lost packet does not stop the arm
                self._why = str(error)
            except TimeoutError as error:  # a late answer would be mistaken for the answer to the next request
                self._why = str(error)
                return

    def _next(self, dt: float) -> np.ndarray | None:
        """Return the next command to send; None before the first command."""
        if self._goals is None or self._pose is None:
            return None
        return self._motors.action(self._goals.towards(self._pose, min(dt, SILENCE)), self._state)

    def _tick(self, now: float, action: np.ndarray | None) -> None:
        """Send the action, if any, and read the state."""
        look = bool(self._eyes) and now - self._seen[0] >= 1.0 / FRAMES
        request: dict[str, Any] = {} if action is None else {"action": action}
        answer = self._link.ask(request | ({"look": 1} if look else {}), WAIT)
        at, state = float(answer["time"]), answer["state"]
        if self._newest is None or action is None:
            self._state = state  # the last before the first command: motors without a joint are held there
        q = self._motors.angles(state)
        if look:
            lerobot_names = {name: lerobot_name for name, (lerobot_name, _, _) in self._eyes.items()}
            images = {name: answer[f"camera.{key}"] for name, key in lerobot_names.items()}
            self._seen = now, {name: self._picture(name, image) for name, image in images.items()}
        self._newest = Reading(at, q, self._slope.add(at, q), None)

    def _picture(self, name: str, image: np.ndarray) -> Picture:
        """Return LeRobot's image as a picture, with the lens that the file states."""
        _, eye, part = self._eyes[name]
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            raise UserError("not a colour picture", key=name, expected="(H, W, 3) of 0 to 255", got=image.shape)
        camera = None
        if part.fx is not None:
            lens = {key: getattr(part, key) for key in ("fx", "fy", "cx", "cy", "distortion")}
            camera = eye.moved(height=image.shape[0], width=image.shape[1], **lens)
        return Picture(np.ascontiguousarray(image), None, camera)

    def read(self, cameras: Sequence[str] = ()) -> Reading:
        """See Driver. Raises TimeoutError: no reading for too long; the error gives the reason."""
        newest, (at, pictures) = self._newest, self._seen
        assert newest is not None
        now = time.monotonic()
        if now - newest.time > SILENCE and self._why:
            raise TimeoutError(self._why)
        if cameras and now - at > BLIND:
            raise TimeoutError(f"no picture for {BLIND:g} s")
        return Reading(newest.time, newest.q, newest.dq, None, {name: pictures[name] for name in cameras})

    def command(self, pose: np.ndarray) -> None:
        """See Driver."""
        assert self._newest is not None
        with self._lock:
            if self._goals is None:
                self._goals = JointGoals(self._interface, self._newest.q)
            self._pose = np.array(pose, float)

    def stop(self) -> None:
        """See Driver: holds the current angles if the arm was ever commanded."""
        with self._lock:
            if self._goals is not None and self._newest is not None:
                self._goals = JointGoals(self._interface, self._newest.q)
                self._pose = self._interface.flange(self._newest.q)

    def close(self) -> None:
        """Disconnect from the arm."""
        self._over.set()
        if self._thread is not None:
            self._thread.join(WAIT)
        with suppress(OSError):
            self._link.close(LEAVE)
