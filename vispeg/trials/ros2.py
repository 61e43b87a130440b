"""The driver of an arm over ROS 2: `--robot ros2`, or `ros2:FILE.yaml` with the names of its topics (docs/run.md).

A controller on the robot's side, such as CRISP's, holds the pose received on `target_pose`; joints, wrench and pictures
are received here. Nothing is sent before the policy's first command.
"""

from __future__ import annotations

import atexit
import importlib
import os
import re
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from vispeg.control.laws import rotation_vector
from vispeg.core.errors import UserError
from vispeg.core.rotation import quaternion
from vispeg.formats.typed import typed
from vispeg.formats.yaml_data import read_yaml
from vispeg.interface.builder import Picture
from vispeg.interface.interface import Interface
from vispeg.recordings import load_cell
from vispeg.recordings.importers.camera_info import described
from vispeg.recordings.schema import Quaternion, Vec3, WrenchSection
from vispeg.render.cameras.camera import Camera, rotation
from vispeg.render.image_kinds import RGB, camera_of, kind_of
from vispeg.trials.driver import Connected, Reading

PIP = "pip install ros-rclpy ros-rmw-fastrtps-cpp ros-sensor-msgs ros-geometry-msgs"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
WAIT = 5.0  # s, longest wait for the first message on every topic
LISTENS = 0.5  # s, longest wait for the controller and its pose; half of what the run loop's watchdog allows
SILENCE = 0.25  # s, longest time without a wrench, as in the run loop for joints
BLIND = 0.5  # s, longest time without a picture; cameras are slower than joints
APART = 0.005, np.deg2rad(2.0)  # m, rad: larger than the error of an arm's model at rest
COLOURS, DEPTHS = ("rgb8", "bgr8"), {"16UC1": ("u2", 1e-3), "32FC1": ("f4", 1.0)}  # encoding -> type, m per unit

TOPIC = r"~?/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*"
Name = Annotated[str, Field(min_length=1)]
Topic = Annotated[str, AfterValidator(lambda name: _topic(name))]


def _topic(name: str) -> str:
    if not re.fullmatch(TOPIC, name, re.ASCII):
        raise ValueError("is not a topic name of ROS 2")
    return name


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class WrenchTopic(WrenchSection):
    """Topic and convention of the wrench: by default on the flange, in its axes, without the tool's weight."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    topic: Topic = "wrench"
    acts_on: Literal["tool", "flange"] = "flange"
    tared: Literal[False, True, "weight"] = "weight"


class FramePart(_Part):
    """Pose in the flange of the frame that the controller holds: position, m, and quaternion w x y z."""

    pos_m: Vec3 = [0.0, 0.0, 0.0]
    quat: Quaternion = [1.0, 0.0, 0.0, 0.0]

    @property
    def pose(self) -> np.ndarray:
        """The pose (7,): m, and the normalized quaternion w x y z."""
        return np.array([*self.pos_m, *(np.array(self.quat) / np.linalg.norm(self.quat))])


class CameraTopics(_Part):
    """Topics of a camera; by default NAME/rgb, NAME/depth and NAME/camera_info.

    `rectified` states that lens distortion was removed from the pictures, so that the matrix P of camera_info applies.
    """

    rgb: Topic | None = None
    depth: Topic | None = None
    info: Topic | None = None
    rectified: bool = False


class Topics(_Part):
    """Content of `ros2:FILE.yaml`; without a file, the defaults hold."""

    namespace: Topic | None = None
    joint_states: Topic = "joint_states"
    joints: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None
    target_pose: Topic = "target_pose"
    current_pose: Topic = "current_pose"
    base_frame: Name = "base"
    end_effector: FramePart = FramePart()
    wrench: WrenchTopic = WrenchTopic()
    cameras: dict[str, CameraTopics] = {}

    def camera(self, name: str) -> CameraTopics:
        """Return the topics of a camera, with defaults filled in."""
        stated = self.cameras.get(name, CameraTopics())
        defaults = {"rgb": f"{name}/rgb", "depth": f"{name}/depth", "info": f"{name}/camera_info"}
        return stated.model_copy(update={key: getattr(stated, key) or value for key, value in defaults.items()})


def read_topics(file: str | Path) -> Topics:
    """Read a file of topics.

    Raises:
        UserError: no such file, invalid YAML, an unknown key or an impossible value.
    """
    return typed(Topics, read_yaml(file) or {}, file)


class Link:
    """A ROS 2 node with a thread that receives messages.

    Args:
        name: name of the node.
        topics: names of the topics, including the node's namespace.

    Attributes:
        node, context: the objects of rclpy.
        sensor, geometry: the modules sensor_msgs.msg and geometry_msgs.msg.

    Raises:
        UserError: this Python has no ROS 2.
    """

    def __init__(self, name: str, topics: Topics):
        try:
            modules = ("rclpy", *(f"rclpy.{m}" for m in ("signals", "qos", "executors", "time", "duration")))
            modules += ("sensor_msgs.msg", "geometry_msgs.msg")
            rclpy, signals, qos, executors, times, durations, *kinds = map(importlib.import_module, modules)
            self.sensor, self.geometry = kinds
        except ImportError as error:
            what = f"ROS 2 needs {error.name or 'rclpy'}, which this Python does not have"
            expected = f"ROS 2's setup.bash sourced, or {PIP} (Python 3.11 or 3.12)"
            raise UserError(what, key="--robot", expected=expected) from error
        self._time, self._duration = times.Time, durations.Duration
        os.environ.setdefault(RANGE, "LOCALHOST")
        # best effort is compatible with every publisher
        self._newest = qos.QoSProfile(depth=1, reliability=qos.ReliabilityPolicy.BEST_EFFORT)
        self.context = rclpy.Context()
        quiet = ["vispeg", "--ros-args", "--disable-external-lib-logs"]  # write no log in the user's home
        rclpy.init(args=quiet, context=self.context, signal_handler_options=signals.SignalHandlerOptions.NO)
        off = {"start_parameter_services": False, "enable_rosout": False}
        self.node = rclpy.create_node(name, namespace=topics.namespace, context=self.context, **off)
        self._executor = executors.SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._heard: dict[str, tuple[Any, float]] = {}  # topic -> its newest message, and when it came (monotonic, s)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        atexit.register(self.close)  # a running ROS 2 thread would abort the interpreter at exit

    def _spin(self) -> None:
        with suppress(Exception):  # errors during shutdown
            self._executor.spin()

    def listen(self, kind: type, topic: str, wanted: Any = None) -> str:
        """Subscribe to a topic, keep its newest message that is `wanted(message)`, and return its full name."""
        name = self.node.resolve_topic_name(topic)

        def hear(message: Any) -> None:
            if wanted is None or wanted(message):
                self._heard[name] = message, time.monotonic()

        self.node.create_subscription(kind, name, hear, self._newest)
        return name

    def speak(self, kind: type, topic: str) -> Any:
        """Return a publisher whose quality of service suits reliable and best-effort subscribers."""
        return self.node.create_publisher(kind, topic, 1)

    def sent(self, publisher: Any, wait: float) -> bool:
        """Wait until every reliable subscriber has a publisher's last message, at most `wait` s; return whether."""
        return publisher.wait_for_all_acked(self._duration(seconds=wait))

    def stamp(self, moment: float) -> Any:
        """Return a time, s since 1970, as a ROS 2 time message."""
        return self._time(nanoseconds=round(1e9 * moment)).to_msg()

    def newest(self, name: str, silence: float = np.inf) -> Any:
        """Return the newest message of a topic. Raises TimeoutError: none for `silence` s."""
        message, at = self._heard.get(name, (None, -np.inf))
        if message is None or time.monotonic() - at > silence:
            raise TimeoutError(f"nothing came on {name} for {silence:g} s")
        return message

    def forget(self) -> None:
        """Discard all messages received so far."""
        self._heard.clear()

    def lacking(self, names: Sequence[str], wait: float) -> list[str]:
        """Wait until all these topics have a message, at most `wait` s; return those without one."""
        until = time.monotonic() + wait
        while (lacking := [n for n in names if n not in self._heard]) and time.monotonic() < until:
            time.sleep(0.005)
        return lacking

    def close(self) -> None:
        """Shut down the node and its thread."""
        atexit.unregister(self.close)
        self.context.try_shutdown()  # wakes the thread
        self._thread.join(2.0)
        self._executor.shutdown(timeout_sec=1.0)
        self.node.destroy_node()


class Ros2Robot:
    """Drive an arm over ROS 2.

    Args:
        file: file with the names of topics, see Topics; "" for the defaults.
    """

    def __init__(self, file: str):
        self.file, self.topics = file or None, read_topics(file) if file else Topics()
        self._link = Link("vispeg", self.topics)
        self._interface: Interface | None = None
        self._target: Any = None  # publisher of poses; made by the first command, as a shadow run must not publish
        # names in a message -> the index there of each joint of the arm; None if a joint is missing
        self._orders: dict[tuple[str, ...], np.ndarray | None] = {}

    def connect(self, interface: Interface, seed: int) -> Connected:
        """See Driver. Raises UserError: a topic is missing or silent, or the robot is another arm."""
        if self._interface is None:
            self._listen(interface)
        self._link.forget()
        if lacking := self._link.lacking(list(self._types), WAIT):
            raise self._missing(lacking[0])
        try:
            self._agrees(self.read().q)
        except TimeoutError as error:
            raise UserError(str(error), key="--robot") from error
        sensor = load_cell.wrench(self.topics.wrench)
        assert sensor is not None
        return Connected(wrench=sensor)

    def _listen(self, interface: Interface) -> None:
        link, t = self._link, self.topics
        self._names = t.joints or interface.arm.joints
        if len(self._names) != len(interface.arm.joints):
            expected = f"{len(interface.arm.joints)} names, in the order {', '.join(interface.arm.joints)}"
            raise UserError(
                "names of another arm", file=self.file, key="joints", expected=expected, got=len(self._names)
            )
        self._joints = link.listen(link.sensor.JointState, t.joint_states, self._ours)
        self._force = link.listen(link.geometry.WrenchStamped, t.wrench.topic)
        self._pose = link.listen(link.geometry.PoseStamped, t.current_pose)
        self._types = {
            self._joints: "sensor_msgs/msg/JointState",
            self._force: "geometry_msgs/msg/WrenchStamped",
        }
        self._eyes: dict[str, Camera] = {}
        self._views: dict[str, dict[str, str]] = {}  # camera -> `rgb`, `depth` or `info` -> topic
        for key, seen in interface.images.items():
            name = camera_of(key)
            topics, view = t.camera(name), self._views.setdefault(name, {})
            self._eyes[name] = seen.eye
            part = "rgb" if kind_of(key) is RGB else "depth"
            view[part] = link.listen(link.sensor.Image, getattr(topics, part))
            if "info" not in view:
                view["info"] = link.listen(link.sensor.CameraInfo, topics.info or "")
            self._types |= {view[part]: "sensor_msgs/msg/Image", view["info"]: "sensor_msgs/msg/CameraInfo"}
        self._interface = interface

    def _ours(self, message: Any) -> bool:
        """Return whether a message has all joints of the arm, in any order; a gripper may use the same topic."""
        names = tuple(message.name)
        if names not in self._orders:
            ours = set(self._names) <= set(names)
            self._orders[names] = np.array([names.index(n) for n in self._names]) if ours else None
        return self._orders[names] is not None

    def _missing(self, name: str) -> UserError:
        """Return the error that explains why a topic has no usable message."""
        kind = self._types[name]
        if name == self._joints and self._orders:
            expected = f"{', '.join(self._names)}; the key `joints` of ros2:FILE.yaml says how they are called"
            return UserError("does not name the arm's joints", key=name, expected=expected, got=[*self._orders][0])
        publishers = self._link.node.get_publishers_info_by_topic(name)
        if not publishers:
            expected = f"{kind}, looked for with {RANGE}={os.environ[RANGE]}"
            return UserError("nobody publishes it", key=name, expected=expected)
        return UserError(f"is silent for {WAIT:g} s", key=name, expected=kind, got=publishers[0].topic_type)

    def _agrees(self, q: np.ndarray) -> None:
        """Raise UserError if the controller reports another frame than the one that would be commanded."""
        if self._link.lacking([self._pose], LISTENS):  # a controller need not publish its pose
            return
        p = self._link.newest(self._pose).pose
        o = p.orientation
        held = np.array([p.position.x, p.position.y, p.position.z, o.w, o.x, o.y, o.z])
        commanded = composed(self._flange(q), self.topics.end_effector.pose)
        turn_off = rotation_vector(held[None, 3:], commanded[None, 3:])
        off = np.linalg.norm(held[:3] - commanded[:3]), np.linalg.norm(turn_off)
        if off[0] <= APART[0] and off[1] <= APART[1]:
            return
        pos, turn = self._flange(q)[:3], rotation(self._flange(q)[3:])
        offset = turn.T @ (held[:3] - pos), quaternion(turn.T @ rotation(held[3:]))
        place, quat = ((np.round(x, 4) + 0.0).tolist() for x in offset)  # + 0.0 makes 0 of -0
        apart = f"{1e3 * off[0]:.1f} mm and {np.rad2deg(off[1]):.1f} degrees"
        expected = f"another base_frame there, or in ros2:FILE.yaml end_effector: {{pos_m: {place}, quat: {quat}}}"
        what = f"the controller holds a frame {apart} away from the one that would be commanded"
        raise UserError(what, key=self._pose, expected=expected)

    def _flange(self, q: np.ndarray) -> np.ndarray:
        assert self._interface is not None
        return self._interface.flange(q)

    def read(self, cameras: Sequence[str] = ()) -> Reading:
        """See Driver. Raises TimeoutError: no wrench for SILENCE or no picture for BLIND seconds."""
        message = self._link.newest(self._joints)  # the run loop notices if its time stamp stays the same
        order = self._orders[tuple(message.name)]
        q, dq = (np.array(values, float) for values in (message.position, message.velocity))
        if min(len(q), len(dq)) < len(message.name):
            got = f"{len(q)} angles, {len(dq)} velocities"
            raise UserError(
                "lacks an angle or a velocity for some joint", key=self._joints, expected=len(message.name), got=got
            )
        stamp = message.header.stamp
        if not (stamp.sec or stamp.nanosec):
            raise UserError("has no time stamp", key=self._joints, expected="header.stamp")
        w = self._link.newest(self._force, SILENCE).wrench
        felt = np.array([w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z])
        pictures = {name: self._picture(name) for name in cameras}
        return Reading(stamp.sec + 1e-9 * stamp.nanosec, q[order], dq[order], felt, pictures)

    def _picture(self, name: str) -> Picture:
        view = self._views[name]
        camera = camera_from(self._link.newest(view["info"]), self._eyes[name], view["info"], self._rectified(name))
        images = {part: image_from(self._link.newest(view[part], BLIND), view[part]) for part in view if part != "info"}
        for part, image in images.items():
            size = camera.height, camera.width
            if image.shape[:2] != size:
                raise UserError(
                    "has another size than its camera_info", key=view[part], expected=size, got=image.shape[:2]
                )
            if (part == "rgb") != (image.ndim == 3):
                what = "a depth picture" if image.ndim == 2 else "a colour picture"
                raise UserError(f"is {what}", key=view[part], expected=part)
        return Picture(images.get("rgb"), images.get("depth"), camera)

    def _rectified(self, name: str) -> bool:
        return self.topics.camera(name).rectified

    def command(self, pose: np.ndarray) -> None:
        """See Driver. Raises UserError: no controller subscribes to the topic, or another node publishes on it."""
        link = self._link
        if self._target is None:
            self._target = link.speak(link.geometry.PoseStamped, self.topics.target_pose)
            until, name = time.monotonic() + LISTENS, self._target.topic_name
            # a subscriber that is known, but not connected yet, would miss the first pose
            while self._target.get_subscription_count() < max(1, link.node.count_subscribers(name)):
                if time.monotonic() > until:
                    break
                time.sleep(0.001)
            if not self._target.get_subscription_count():
                raise UserError(
                    "nobody listens", key=name, expected="a controller that holds geometry_msgs/PoseStamped"
                )
            if (others := link.node.count_publishers(name)) > 1:
                raise UserError("somebody else publishes it too", key=name, expected=1, got=others)
        self._send(pose)

    def _send(self, pose: np.ndarray) -> None:
        message = self._link.geometry.PoseStamped()
        message.header.frame_id, message.header.stamp = self.topics.base_frame, self._link.stamp(time.time())
        p, o = message.pose.position, message.pose.orientation
        p.x, p.y, p.z, o.w, o.x, o.y, o.z = map(float, composed(np.asarray(pose), self.topics.end_effector.pose))
        self._target.publish(message)

    def stop(self) -> None:
        """See Driver: holds the arm's current pose if the arm was ever commanded."""
        if self._target is not None:
            message = self._link.newest(self._joints)
            self._send(self._flange(np.array(message.position, float)[self._orders[tuple(message.name)]]))

    def close(self) -> None:
        """Shut down the node, once the pose at which the arm stops has arrived."""
        if self._target is not None:
            self._link.sent(self._target, LISTENS)
        self._link.close()


def composed(pose: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return the pose (7,) of a frame that lies at `offset` (7,) in the frame at `pose` (7,): m, quaternion w x y z.

    A zero offset returns `pose` itself, bit for bit.
    """
    if np.array_equal(offset, [0, 0, 0, 1, 0, 0, 0]):
        return pose
    # no rotation matrix in between: a product of quaternions keeps its sign from pose to pose, as a filter may need
    (w, *v), (a, *b) = pose[3:], offset[3:]
    turn = w * np.array(b) + a * np.array(v) + np.cross(v, b)
    return np.concatenate([pose[:3] + rotation(pose[3:]) @ offset[:3], [w * a - np.dot(v, b)], turn])


def image_from(message: Any, name: str) -> np.ndarray:
    """Convert a sensor_msgs/Image to (H, W, 3) uint8 sRGB, or to (H, W) depth in m with 0 or NaN for no reading.

    Raises:
        UserError: an unknown encoding, or fewer bytes than the size needs.
    """
    m, colour = message, message.encoding in COLOURS
    if not colour and m.encoding not in DEPTHS:
        raise UserError("an encoding that is not read", key=name, got=m.encoding, choices=(*COLOURS, *DEPTHS))
    code, unit = ("u1", 1.0) if colour else DEPTHS[m.encoding]
    kind = np.dtype((">" if m.is_bigendian else "<") + code)
    across = m.width * (3 if colour else 1) * kind.itemsize
    data = np.frombuffer(m.data, np.uint8)
    if m.step < across or len(data) < m.height * m.step:
        raise UserError(
            "has fewer bytes than its size needs",
            key=name,
            expected=f"{m.height} rows of {across}",
            got=f"{len(data)}, in rows of {m.step}",
        )
    rows = data[: m.height * m.step].reshape(m.height, m.step)[:, :across]
    values = np.ascontiguousarray(rows).view(kind)
    if not colour:
        return values.astype(np.float32) * np.float32(unit)
    image = values.reshape(m.height, m.width, 3)
    return np.ascontiguousarray(image[..., ::-1] if m.encoding == "bgr8" else image)


def camera_from(info: Any, eye: Camera, name: str, rectified: bool = False) -> Camera:
    """Return the camera with the lens of a sensor_msgs/CameraInfo and the pose of the policy's camera `eye`.

    Raises:
        UserError: as `described`.
    """
    return eye.moved(**described(eye.name, info, rectified, key=name).lens)
