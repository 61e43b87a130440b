"""Closed loops for the tests: a pendulum whose equation fits in a line, the iiwa, and segments to drive them with."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp
from zlib import crc32

import numpy as np

from vispeg.core.effect import Effect, EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.identify.excitation import SEVEN_AXIS_CENTRE, motion
from vispeg.recordings.recording import Control, Nullspace, Recording
from vispeg.robots.model import RobotModel, load
from vispeg.sim.rollout import Response, simulate
from vispeg.sim.segments.segment import Segment
from vispeg.worlds.world import World

KP = np.array([800.0, 800, 300, 400, 100, 60, 5])  # N m/rad, for the iiwa at 500 Hz
KD = np.array([20.0, 30, 6, 12, 1.5, 0.8, 0.08])  # N m s/rad
MASS, COM, INERTIA, GRAVITY = 2.0, 0.3, 0.02, 9.81  # the pendulum: kg, m, kg m^2 about its centre of mass, m/s^2
SWING = INERTIA + MASS * COM**2  # kg m^2 about the hinge
WEIGHT = MASS * GRAVITY * COM  # N m, horizontal

PENDULUM = """
<mujoco><compiler angle="radian"/><option gravity="0 0 {gravity}"/>
  <worldbody><body name="base">
    <body name="link"><joint name="hinge" type="hinge" axis="0 1 0"/>
      <inertial pos="0 0 -{com}" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
      <site name="flange" pos="0 0 -0.6"/></body></body></worldbody></mujoco>
"""

# a shoulder and an elbow, hanging
ARM = """
<mujoco><compiler angle="radian"/>
  <worldbody><body name="base">
    <body name="upper"><joint name="shoulder" axis="0 1 0"/>
      <inertial pos="0 0 -0.2" mass="2" diaginertia="0.02 0.02 0.02"/>
      <body name="lower" pos="0 0 -0.4"><joint name="elbow" axis="0 1 0"/>
        <inertial pos="0 0 -0.15" mass="1" diaginertia="0.01 0.01 0.01"/>
        <site name="flange" pos="0 0 -0.3"/></body></body></body></worldbody></mujoco>
"""


@lru_cache
def pendulum(gravity: float = -GRAVITY) -> RobotModel:
    """One hinge about y, hanging: `SWING ddq = tau - WEIGHT sin q`; no weight where gravity is 0."""
    path = Path(mkdtemp()) / "pendulum.xml"
    path.write_text(PENDULUM.format(gravity=gravity, com=COM, mass=MASS, inertia=INERTIA))
    return load(path)


@lru_cache
def arm() -> RobotModel:
    """A shoulder and an elbow, hanging."""
    path = Path(mkdtemp()) / "arm.xml"
    path.write_text(ARM)
    return load(path)


def drive(
    robot: RobotModel,
    mode: str,
    q0: np.ndarray | float = 0.0,
    *,
    command: np.ndarray | None = None,
    dq_cmd: np.ndarray | None = None,
    dq0: np.ndarray | float = 0.0,
    seconds: float = 1.0,
    rate: float = 1000.0,
    kp: float | np.ndarray = 0.0,
    kd: float | np.ndarray = 0.0,
    compensation: str = "none",
    nullspace: Nullspace | None = None,
) -> Segment:
    """A segment that starts at (q0, dq0) and holds `command` (n, ...) or its single row; the mode names the command.

    For a law in open loop take the mode `passive`, and `one(.., observer=False)`.
    """
    n, nj = round(seconds * rate), len(robot.joints)
    width = 6 if mode == "osc" else nj
    gains = [np.broadcast_to(np.asarray(g, float), (width,)).copy() for g in (kp, kd)]
    control = Control(mode, rate, compensation, *gains, nullspace)
    still = np.broadcast_to(np.asarray(q0, float), (n, nj)).copy()
    moving = np.broadcast_to(np.asarray(dq0, float), (n, nj)).copy()
    name = {"position": "q_cmd", "servo": "q_cmd", "osc": "ee_cmd"}.get(mode, "tau_cmd")
    default = still if name == "q_cmd" else np.zeros((n, nj))
    value = (
        default if command is None else np.broadcast_to(np.asarray(command, float), (n, np.shape(command)[-1])).copy()
    )
    commands = {name: value} if dq_cmd is None else {name: value, "dq_cmd": dq_cmd}
    return Segment(control, 1.0 / rate, commands, still, moving, still, np.arange(n) / rate, np.arange(n))


def iiwa_segment(mode: str = "position", seconds: float = 1.0, name: str = "fourier", seed: int = 0) -> Segment:
    """The iiwa on an exciting motion: impedance control, its torques in open loop, its flange by OSC, or goals."""
    robot = load("iiwa14")
    m = motion(name, robot, 500.0, seconds, stream(seed, "motion"))
    common = {"seconds": seconds, "rate": 500.0, "compensation": "model"}
    servo = drive(robot, "position", command=m.q_cmd, dq_cmd=m.dq_cmd, kp=KP, kd=KD, **common)
    servo = Segment(servo.control, servo.tick, servo.command, m.q_cmd, m.dq_cmd, m.q_cmd, servo.time, servo.rows)
    if mode == "position":
        return servo
    if mode == "servo":
        return Segment(Control("servo", 500.0), servo.tick, {"q_cmd": m.q_cmd}, *servo_motion(servo))
    if mode == "osc":
        goal = simulate(robot, [World()], [servo], want_ee=True)[0].ee
        assert goal is not None
        posture = Nullspace(10.0, 6.0, np.array(SEVEN_AXIS_CENTRE))
        loop = drive(robot, "osc", command=goal[0], kp=150.0, kd=24.0, nullspace=posture, **common)
    else:
        loop = drive(
            robot, mode, seconds=seconds, rate=500.0, command=simulate(robot, [World()], [servo])[0].tau_motor[0]
        )
    return Segment(loop.control, loop.tick, loop.command, m.q_cmd, m.dq_cmd, m.q_cmd, loop.time, loop.rows)


def servo_motion(s: Segment) -> tuple[np.ndarray, ...]:
    """Return the fields of a segment other than its control, tick and commands."""
    return s.q, s.dq, s.q_raw, s.time, s.rows


def mode_of(kind: Effect) -> str:
    """A control mode under which an effect does something."""
    return "position" if "angle" in kind.channels() else "servo"


def one(robot: RobotModel, world: World, segment: Segment, **options) -> Response:
    """The response of a single world to a single segment.

    In open loop (`passive`, `torque`) the arm is pulled towards the segment's motion unless `observer=False`.
    """
    return simulate(robot, [world], [segment], **options)[0]


def hinge(name: str, **values: float) -> World:
    """The pendulum with one effect at its only target."""
    return World().add(EffectInstance.of(name, effect(name).targets(pendulum())[0], **values))


def recorded(
    robot: RobotModel,
    label: str,
    world: World,
    segment: Segment,
    rng: np.random.Generator,
    q_noise: float = 2e-5,
    tau_noise: float = 0.2,
    h_max: float = 2e-3,
    sensor: str = "joint",
) -> Recording:
    """A noisy recording of a world's response to a segment, in memory; `label` is what a recording calls the robot.

    Its path is of its own, as a folder is: a fit refuses the same recording twice. A commanded robot stands still for a
    while before, so that it starts in balance. A servo's has a load, not a torque.
    """
    rest = 0 if segment.control.mode in ("torque", "passive") else round(0.6 / segment.tick)
    y = one(robot, world, _rested(segment, rest), h_max=h_max)
    q = y.q[0, rest:] + rng.normal(scale=q_noise, size=segment.q.shape)
    servo = segment.control.mode == "servo"
    read = y.tau_motor if servo or sensor == "motor" else y.tau_joint
    tau = read[0, rest:] + rng.normal(scale=tau_noise, size=segment.q.shape)
    felt = {"tau": tau, "torque_sensor": sensor, "noise": {"q": q_noise, "tau": tau_noise}}
    if servo:
        felt = {"load": tau, "noise": {"q": q_noise}}
    path = Path(f"made-up-{crc32(q.tobytes()):08x}")
    return Recording(
        path, label, robot.joints, 1.0 / segment.tick, segment.control, segment.time, q,
        **felt, **segment.command,
    )  # fmt: skip


def swings(world: World, count: int, seconds: float, sensor: str = "joint") -> list[Recording]:
    """Record the pendulum in a world, under position control, on swings each faster than the one before.

    Args:
        world: what is recorded.
        count: number of recordings.
        seconds: length of each, s.
        sensor: of torque.
    """
    robot, out = pendulum(), []
    t = np.arange(round(200 * seconds)) * 5e-3
    for i in range(count):
        q = 0.4 * (1 - np.cos(2 * np.pi * (0.7 + 0.25 * i) * t))[:, None]
        s = drive(robot, "position", q[0], command=q, seconds=seconds, rate=200.0, kp=60.0, kd=4.0)
        out.append(recorded(robot, robot.source, world, s, stream(3, i), sensor=sensor))
    return out


def _rested(s: Segment, rest: int) -> Segment:
    def held(values: np.ndarray, still: bool = False) -> np.ndarray:
        return np.concatenate([np.repeat(values[:1] * (not still), rest, axis=0), values])

    command = {k: held(v, k == "dq_cmd") for k, v in s.command.items()}
    n = len(s.time) + rest
    return Segment(
        s.control, s.tick, command, held(s.q), held(s.dq, True), held(s.q_raw), np.arange(n) * s.tick, np.arange(n)
    )
