"""A simulated arm as a ROS 2 node, to try `vispeg run --robot ros2` without an arm.

    python -m vispeg.trials.ros2_robot --world nominal
    vispeg run state-3mm --robot ros2 --out trials

It publishes joints, wrench and pose at 200 Hz, and pictures, under the names of `ros2:FILE.yaml`, and holds the pose
received on `target_pose`. Like a real arm it does not know about episodes. On its standard input, Enter resets it to
the next start, a number and Enter resets it to that start, and q and Enter quits.
"""

from __future__ import annotations

import argparse
import os
import select
import stat
import sys
import time
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings import load_cell
from vispeg.recordings.cell import WrenchSensor
from vispeg.render.cameras.camera import Camera, rotation
from vispeg.render.image_kinds import MODES, RGB, camera_of, kind_of
from vispeg.task.interface import interface_in
from vispeg.trials.ros2 import Link, Topics, composed, read_topics
from vispeg.trials.simulated import BEHIND, SimulatedRobot

FRAMES = 15.0  # pictures per second
FINGER = "finger_joint"  # an extra joint in the message, as a gripper may add one


class Ros2Node:
    """A simulated robot that publishes and subscribes over ROS 2.

    Args:
        robot: the simulated robot.
        mode: observation mode, which determines the cameras.
        topics: names of the topics.
    """

    def __init__(self, robot: SimulatedRobot, mode: str, topics: Topics):
        self.robot, self.topics = robot, topics
        self.sensor = load_cell.wrench(topics.wrench) or WrenchSensor()
        self.interface = interface_in(robot.config, robot.env.file, mode, modality=mode)
        self.eyes = {camera_of(key): seen.eye for key, seen in self.interface.images.items()}
        self.link = link = Link("simulated_arm", topics)
        self.time = time.time()  # its clock advances evenly, and pauses if the machine is too slow
        self.names = list(topics.joints or self.interface.arm.joints)
        self.joints = link.speak(link.sensor.JointState, topics.joint_states)
        self.pose = link.speak(link.geometry.PoseStamped, topics.current_pose)
        self.force = link.speak(link.geometry.WrenchStamped, topics.wrench.topic)
        self.target = link.listen(link.geometry.PoseStamped, topics.target_pose)
        self.images, self.infos = {}, {}
        for key in self.interface.images:
            camera = topics.camera(camera_of(key))
            name = camera.rgb if kind_of(key) is RGB else camera.depth
            self.images[key] = link.speak(link.sensor.Image, name or "")
        for name in self.eyes:
            self.infos[name] = link.speak(link.sensor.CameraInfo, topics.camera(name).info or "")

    def begin(self, seed: int) -> None:
        """Reset to the start of this number, at rest."""
        start = self.robot.begin(seed)
        self.link.forget()
        self.held, self.reported, self.tare = None, False, None
        print(f"start {seed}, the goal believed at", *(f"{x:.4f}" for x in start["believed_m"]), flush=True)

    def tick(self) -> None:
        """Advance by one control period, then publish the measurements."""
        self._hold()
        self.robot.tick()
        self.time += self.robot.config.control_period
        stamp = self.link.stamp(self.time)
        self._publish_readings(stamp)
        if self.robot.ticks % max(1, round(1 / (FRAMES * self.robot.config.control_period))) == 0:
            self._publish_pictures(stamp)
        if self.held is not None and self.robot.ended is not None and not self.reported:
            self.reported, outcome = True, self.robot.outcome()
            print(f"{outcome['category']}, {outcome['peak_force_n']:.1f} N at most", flush=True)

    def _hold(self) -> None:
        try:
            message = self.link.newest(self.target)
        except TimeoutError:
            return
        if message is self.held:
            return
        if self.held is None:  # the episode begins with the first command
            self.robot.ended = None
            self.robot.sim.count[:] = 0  # policy steps
            print(f"commanded on {self.target}", flush=True)
        self.held = message
        p, o = message.pose.position, message.pose.orientation
        pose = np.array([p.x, p.y, p.z, o.w, o.x, o.y, o.z])
        self.robot.hold(composed(pose, _inverse(self.topics.end_effector.pose)))

    def _publish_readings(self, stamp: Any) -> None:
        link, read = self.link, self.robot.reading()
        joints = link.sensor.JointState()
        joints.header.stamp = stamp
        joints.name = [FINGER, *reversed(self.names)]  # reversed, so that nobody relies on the order
        joints.position, joints.velocity = ([0.0, *x[::-1].tolist()] for x in (read["q"], read["dq"]))
        self.joints.publish(joints)
        pos, turn, _, _ = self.interface.chain.pose(read["q"][None], read["dq"][None])
        self.pose.publish(
            _pose_message(link, composed(np.concatenate([pos[0], turn[0]]), self.topics.end_effector.pose), stamp)
        )
        force = link.geometry.WrenchStamped()
        force.header.stamp = stamp
        f, t = force.wrench.force, force.wrench.torque
        axes = rotation(turn[0])
        if self.tare is None or self.sensor.tared == "weight":
            self.tare = self.interface.tool.weight_at(axes)
        f.x, f.y, f.z, t.x, t.y, t.z = as_read(read["wrench"], self.sensor, axes, self.tare).tolist()
        self.force.publish(force)

    def _publish_pictures(self, stamp: Any) -> None:
        for key, image in self.robot.pictures([*self.eyes]).items():
            message = self.link.sensor.Image()
            message.header.stamp, message.height, message.width = stamp, image.shape[0], image.shape[1]
            data = np.ascontiguousarray(image if image.ndim == 3 else image.astype("<f4"))
            message.encoding = "rgb8" if image.ndim == 3 else "32FC1"
            message.step, message.data = data.strides[0], data.tobytes()
            self.images[key].publish(message)
        for name, publisher in self.infos.items():
            publisher.publish(_info_message(self.link, self.eyes[name], stamp))


def as_read(wrench: np.ndarray, sensor: WrenchSensor, turn: np.ndarray, tare: np.ndarray) -> np.ndarray:
    """Convert a wrench to a sensor's convention, the inverse of `vispeg.recordings.cell.canonical`.

    Args:
        wrench: (6,) wrench of the tool on the flange, weight included, in flange axes, N and N m.
        sensor: the sensor's convention.
        turn: (3, 3) rotation from flange to base.
        tare: (6,) N, N m at the flange, what a tared sensor subtracts: the tool's weight now, or that of its start.
    """
    felt = wrench - tare if sensor.tared else wrench
    force, torque = felt[:3], felt[3:]
    torque = torque - np.cross(sensor.pos, force)
    axes = turn if sensor.frame == "base" else rotation(sensor.quat).T
    return (-1.0 if sensor.acts_on == "tool" else 1.0) * np.concatenate([axes @ force, axes @ torque])


def _inverse(pose: np.ndarray) -> np.ndarray:
    quat = pose[3:] * [1, -1, -1, -1]
    return np.concatenate([-rotation(quat) @ pose[:3], quat])


def _pose_message(link: Link, pose: np.ndarray, stamp: Any) -> Any:
    message = link.geometry.PoseStamped()
    message.header.stamp = stamp
    p, o = message.pose.position, message.pose.orientation
    p.x, p.y, p.z, o.w, o.x, o.y, o.z = pose.tolist()
    return message


def _info_message(link: Link, eye: Camera, stamp: Any) -> Any:
    message = link.sensor.CameraInfo()
    message.header.stamp, message.height, message.width = stamp, eye.height, eye.width
    message.distortion_model, message.d = "plumb_bob", list(eye.distortion)
    message.k = eye.K.reshape(-1)
    message.p = np.pad(eye.K, ((0, 0), (0, 1))).reshape(-1)
    return message


def live(node: Ros2Node, seed: int) -> None:
    """Run in real time until q or the end of standard input; without standard input (/dev/null), run on."""
    period = node.robot.config.control_period
    silent = stat.S_ISCHR(os.fstat(sys.stdin.fileno()).st_mode) and not sys.stdin.isatty()
    inputs = [] if silent else [sys.stdin]
    node.begin(seed)
    due = time.monotonic()
    while True:
        due += period
        if select.select(inputs, [], [], max(0.0, due - time.monotonic()))[0]:
            line = sys.stdin.readline()
            if not line or line.strip() == "q":
                return
            seed = int(line) if line.strip().isdigit() else seed + 1
            node.begin(seed)
            due = time.monotonic()
        elif (behind := time.monotonic() - due) > BEHIND:
            due += behind
        node.tick()


def main() -> int:
    """Parse the command line and run the simulated robot."""
    parser = argparse.ArgumentParser(
        prog="python -m vispeg.trials.ros2_robot",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--world", default="nominal", help="a built-in world, or a world file")
    parser.add_argument("--topics", help="FILE.yaml with the names of the topics")
    parser.add_argument(
        "--see", default="state", choices=sorted(MODES), help="observation mode whose cameras publish pictures"
    )
    parser.add_argument("--seed", type=int, default=1, help="number of the first start")
    args = parser.parse_args()
    try:
        topics = read_topics(args.topics) if args.topics else Topics()
        node = Ros2Node(SimulatedRobot(args.world, args.see, {}), args.see, topics)
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    try:
        live(node, args.seed)
    except KeyboardInterrupt:
        pass
    finally:
        node.link.close()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
