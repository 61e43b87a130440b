"""Recordings of a simulated robot: a world driven as a real robot is, read by noisy sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vispeg.core.errors import UserError
from vispeg.identify.excitation import Motion, room_of
from vispeg.identify.gains import servo
from vispeg.recordings.noise import noisy
from vispeg.recordings.recording import Control, Nullspace, Recording
from vispeg.robots.declared import declared
from vispeg.robots.model import RobotModel, load
from vispeg.sim.compiled import flange_pose
from vispeg.sim.rollout import Response, simulate
from vispeg.sim.segments.segment import Segment
from vispeg.worlds.world import World

OSC_KP, OSC_KD = 150.0, 24.0  # 1/s^2, 1/s
NULL_KP, NULL_KD = 10.0, 6.0  # 1/s^2, 1/s
PLANT_STEP = 5e-4  # s


def controller(
    robot: RobotModel,
    mode: Literal["position", "torque", "osc", "servo"],
    rate_hz: float,
    centre: np.ndarray,
    kp: np.ndarray | None = None,
    kd: np.ndarray | None = None,
) -> Control:
    """A controller of RECORDING.md with default gains where none are given; nominal gravity is compensated.

    Servos take goals: their loop is their own, and effects are what is said of it.

    Raises:
        UserError: gains of the wrong length or sign, or gains of servos.
    """
    if mode == "servo":
        if kp is not None or kd is not None:
            raise UserError("a servo's loop is its own", key="gains", expected="--effects servo:WHERE to change it")
        return Control("servo", rate_hz)
    width = 6 if mode == "osc" else len(robot.joints)
    default = (np.full(6, OSC_KP), np.full(6, OSC_KD)) if mode == "osc" else servo(robot, centre, rate_hz)
    gains = []
    for name, stated, usual in (("kp", kp, default[0]), ("kd", kd, default[1])):
        value = usual if stated is None else np.asarray(stated, float)
        if value.shape != (width,) or not (np.isfinite(value) & (value >= 0)).all():
            raise UserError("wrong gains", key=name, expected=f"{width} numbers, none negative", got=value.tolist())
        gains.append(value)
    null = Nullspace(NULL_KP, NULL_KD, np.array(centre, float)) if mode == "osc" else None
    return Control(mode, rate_hz, "model", gains[0], gains[1], null)


def record(
    world: World,
    motion: Motion,
    control: Control,
    noise: Mapping[str, float],
    rng: np.random.Generator,
    *,
    torque_sensor: Literal["joint", "motor", "none"] = "joint",
    repeat: int = 1,
    name: str = "simulated",
    nthread: int = 1,
    watch: Callable[[np.ndarray], None] = lambda true: None,
) -> Recording:
    """Drives a world through a motion and reads its sensors; of servos only angles and loads.

    Args:
        world: the plant, effects included; its tool is declared in the recording, its effects are not.
        motion: the command; `ee_cmd` is derived from `q_cmd` where an osc controller needs one.
        control: the controller. In mode `torque` the joint servo with these gains computes `tau_cmd`.
        noise: 1-sigma of white noise on `q`, `dq`, `tau`, `ee`; it is added to what was read, after the loop.
        rng: the only source of chance.
        torque_sensor: what `tau` measures; `none` leaves it out. A servo has a `load` instead, its motor's torque.
        repeat: how often the same motion is run; more than one run become episodes.
        name: what the recording is called.
        nthread: threads of the simulation.
        watch: is shown the true joint angles (n, nj) rad of a run, which only a bystander (a camera) can see.

    Raises:
        UserError: the arm does not follow (the controller is unstable with this plant).
    """
    robot = load(world.robot, tool=world.tool)
    segment, response = drive(world, motion, control, nthread, want_ee=True)
    if response.true is not None:
        watch(response.true[0])
    q, dq, tau = response.q[0], response.dq[0], response.tau_motor[0]
    signals = {"q": q, "dq": dq, "ee": response.ee[0] if response.ee is not None else flange_pose(robot, q)}
    if torque_sensor != "none":
        signals["tau"] = response.tau_joint[0] if torque_sensor == "joint" else tau
    fixed: dict[str, np.ndarray] = {}
    if control.mode == "osc":
        fixed["ee_cmd"] = segment.command["ee_cmd"]
    else:
        fixed = {"q_cmd": motion.q_cmd, "dq_cmd": motion.dq_cmd}
        del signals["ee"]
    if control.mode == "servo":
        del fixed["dq_cmd"]
        signals, torque_sensor = {"q": q, "load": tau}, "none"
    if control.mode == "torque":
        fixed = {"tau_cmd": control.kp * (motion.q_cmd - q) + control.kd * (motion.dq_cmd - dq)}
    runs = [{key: noisy(key, v, noise, rng) for key, v in signals.items()} for _ in range(repeat)]
    columns: dict[str, Any] = {key: np.concatenate([r[key] for r in runs]) for key in signals}
    columns |= {key: np.tile(v, (repeat, 1)) for key, v in fixed.items()}
    if repeat > 1:
        columns["episode"] = np.repeat(np.arange(repeat), len(motion.time))
    stated = {key: float(noise[key]) for key in signals if noise.get(key, 0.0) > 0}
    bare = replace(control, kp=None, kd=None) if control.mode == "torque" else control
    return Recording(
        path=Path(name),
        robot=str(Path(world.robot).resolve()) if Path(world.robot).suffix else world.robot,
        joints=robot.joints,
        rate_hz=control.rate_hz,
        control=bare,
        time=np.tile(motion.time, repeat),
        tool=declared(world.robot, world.tool),
        torque_sensor=torque_sensor,
        noise=stated,
        motion=motion.name,
        notes="simulated",
        **columns,
    )


def drive(
    world: World, motion: Motion, control: Control, nthread: int = 1, want_ee: bool = False
) -> tuple[Segment, Response]:
    """What a controller is told, and what the sensors of one world then read, without their noise.

    Raises:
        UserError: the arm does not follow (the controller is unstable with this plant).
    """
    robot = load(world.robot, tool=world.tool)
    closed = replace(control, mode="position") if control.mode == "torque" else control
    segment = _segment(robot, motion, closed)
    response = simulate(robot, [world], [segment], h_max=PLANT_STEP, nthread=nthread, want_ee=want_ee)[0]
    if response.diverged[0]:
        raise UserError("the arm does not follow: the loop is unstable", expected="lower gains or a higher rate")
    return segment, response


def centre_of(robot: RobotModel) -> np.ndarray:
    """The posture (nj,) rad about which motions move."""
    return room_of(robot, 100.0, 1.0).centre


def _segment(robot: RobotModel, motion: Motion, control: Control) -> Segment:
    command = {"q_cmd": motion.q_cmd, "dq_cmd": motion.dq_cmd}
    if control.mode == "osc":
        command = {"ee_cmd": flange_pose(robot, motion.q_cmd) if motion.ee_cmd is None else motion.ee_cmd}
    elif motion.ee_cmd is not None:
        raise UserError("the motion 'osc' moves the flange", key="--control", expected="osc", got=control.mode)
    rows = np.arange(len(motion.time))
    tick = 1.0 / control.rate_hz
    return Segment(control, tick, command, motion.q_cmd, motion.dq_cmd, motion.q_cmd, motion.time, rows)
