"""Record a simulated robot: a world driven like a real robot and read by noisy sensors."""

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
from vispeg.sim.rollout import ReadingNoise, Response, rounds, simulate
from vispeg.sim.segments.segment import Segment
from vispeg.worlds.world import World

OSC_KP, OSC_KD = 150.0, 24.0  # 1/s^2, 1/s, per unit of mass: near critical damping, 2 sqrt(150)
NULL_KP, NULL_KD = 10.0, 6.0  # the same of the null space: near 2 sqrt(10)
REST = 1.0  # s that an arm holds the first posture of a motion: it stands in balance when the recording begins
PLANT_STEP = 5e-4  # s, greatest physics step of a recorded world: finer than the steps of the fits


def controller(
    robot: RobotModel,
    mode: Literal["position", "torque", "osc", "servo"],
    rate_hz: float,
    centre: np.ndarray,
    kp: np.ndarray | None = None,
    kd: np.ndarray | None = None,
) -> Control:
    """Return a controller as docs/formats.md defines it, by default with usual gains; it compensates nominal gravity.

    A servo takes position goals only and has no gains here: its loop is built in, and effects describe it.

    Args:
        robot: the arm.
        mode: of control; in mode `torque` the gains are of the loop that computes the torques.
        rate_hz: control rate.
        centre: posture (nj,) rad, about which default gains are stable, and to which an OSC null space pulls.
        kp, kd: gains, one per joint (N m/rad, N m s/rad), or six for `osc` (1/s^2, 1/s).

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
    """Drive a world through a motion and read its sensors; servos have only angles and loads.

    Args:
        world: the plant, effects included; its tool is declared in the recording, its effects are not.
        motion: the command; `ee_cmd` is derived from `q_cmd` if an osc controller needs it.
        control: the controller. In mode `torque` a joint position loop with these gains computes `tau_cmd`.
        noise: 1-sigma of white noise on `q` (rad), `dq` (rad/s), `tau` (N m; also of a load) and the position of `ee`
            (m). It is added to the recorded readings only, not in the loop. If any encoder has steps, the noise of all
            angles is added in the loop instead, before rounding.
        rng: random generator.
        torque_sensor: what `tau` measures; `none` leaves it out. A servo has a `load` instead, its motor's torque.
        repeat: how often the same motion is run; several runs become episodes.
        name: name of the recording.
        nthread: threads of the simulation.
        watch: called with the true joint angles (n, nj) rad of the first run, for an external observer such as a
            camera, if the simulation keeps them.

    Raises:
        UserError: the arm does not follow (the controller is unstable with this plant), or a motion of the flange
            without an osc controller.
    """
    robot, added = load(world.robot, tool=world.tool), dict(noise)  # `added`: noise that is added to the readings
    sensed = None
    if added.get("q", 0.0) > 0 and rounds(world):
        sigma = np.full((repeat, len(robot.joints)), added.pop("q"))
        sensed = ReadingNoise(q=sigma, dq=np.zeros_like(sigma), rng=rng, sensed=True)
    segment, response = drive(world, motion, control, nthread, want_ee=True, sensed=sensed)
    if response.true is not None:
        watch(response.true[0])
    runs = []
    rows = [0] * repeat if sensed is None else range(repeat)  # without noise in the loop all runs are the same
    for row in rows:
        signals, commands = _signals(robot, motion, control, segment, response, row, torque_sensor)
        runs.append({key: noisy(key, v, added, rng) for key, v in signals.items()} | commands)
    torque_sensor = "none" if control.mode == "servo" else torque_sensor
    columns: dict[str, Any] = {key: np.concatenate([run[key] for run in runs]) for key in runs[0]}
    if repeat > 1:
        columns["episode"] = np.repeat(np.arange(repeat), len(motion.time))
    stated = {key: float(noise[key]) for key in signals if noise.get(key, 0.0) > 0}
    # in mode `torque` the gains belong to the loop that made the commands, not to the recorded controller
    gainless = replace(control, kp=None, kd=None) if control.mode == "torque" else control
    return Recording(
        path=Path(name),
        robot=str(Path(world.robot).resolve()) if Path(world.robot).suffix else world.robot,
        joints=robot.joints,
        rate_hz=control.rate_hz,
        control=gainless,
        time=np.tile(motion.time, repeat),
        tool=declared(world.robot, world.tool),
        torque_sensor=torque_sensor,
        noise=stated,
        motion=motion.name,
        notes="simulated",
        **columns,
    )


def _signals(
    robot: RobotModel,
    motion: Motion,
    control: Control,
    segment: Segment,
    response: Response,
    row: int,
    torque_sensor: Literal["joint", "motor", "none"],
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the sensor readings, without noise, in row `row` of a response, and the commands, both by column name."""
    q, dq, tau = response.q[row], response.dq[row], response.tau_motor[row]
    if control.mode == "servo":
        return {"q": q, "load": tau}, {"q_cmd": motion.q_cmd}
    signals = {"q": q, "dq": dq}
    if control.mode == "osc":
        signals["ee"] = response.ee[row] if response.ee is not None else flange_pose(robot, q)
    if torque_sensor != "none":
        signals["tau"] = response.tau_joint[row] if torque_sensor == "joint" else tau
    if control.mode == "osc":
        return signals, {"ee_cmd": segment.command["ee_cmd"]}
    if control.mode == "torque":
        return signals, {"tau_cmd": control.kp * (motion.q_cmd - q) + control.kd * (motion.dq_cmd - dq)}
    return signals, {"q_cmd": motion.q_cmd, "dq_cmd": motion.dq_cmd}


def drive(
    world: World,
    motion: Motion,
    control: Control,
    nthread: int = 1,
    want_ee: bool = False,
    sensed: ReadingNoise | None = None,
) -> tuple[Segment, Response]:
    """Drive one world through a motion, from rest, and return the commands and the response.

    Before, the arm holds the first command for `REST` s, so that what its effects add, such as a payload's sag, has
    come to rest. The response has one row without noise, or, if `sensed` is given, a row for each row of that noise in
    the loop. With `want_ee` it has the flange's poses too.

    Raises:
        UserError: the arm does not follow (the controller is unstable with this plant), or a motion of the flange
            without an osc controller.
    """
    robot = load(world.robot, tool=world.tool)
    # torques from a joint position loop: the same closed loop as mode `position`, with the commands known afterwards
    closed = replace(control, mode="position") if control.mode == "torque" else control
    segment = _segment(robot, motion, closed)
    worlds, rest = [world] * (1 if sensed is None else len(sensed.q)), round(REST * control.rate_hz)
    options = {"h_max": PLANT_STEP, "nthread": nthread, "want_ee": want_ee, "reading_noise": sensed}
    (response,) = simulate(robot, worlds, [_held(segment, rest)], **options)
    if response.diverged.any():
        raise UserError("the arm does not follow: the loop is unstable", expected="lower gains or a higher rate")
    moving = {name: getattr(response, name) for name in ("q", "dq", "tau_joint", "tau_motor", "ee", "true")}
    return segment, replace(response, **{k: None if v is None else v[:, rest:] for k, v in moving.items()})


def _held(segment: Segment, rest: int) -> Segment:
    """Return the segment with its first command held, at rest, for `rest` ticks before it."""

    def before(values: np.ndarray, still: bool = False) -> np.ndarray:
        """Return the values after `rest` rows of the first one, or of zeros if `still`."""
        return np.concatenate([np.repeat(values[:1] * (not still), rest, axis=0), values])

    command = {name: before(values, name == "dq_cmd") for name, values in segment.command.items()}
    q, dq, raw = before(segment.q), before(segment.dq, True), before(segment.q_raw)
    rows = np.arange(rest + segment.ticks)
    begun = segment.begun - rest * segment.tick
    return Segment(segment.control, segment.tick, command, q, dq, raw, rows * segment.tick, rows, begun)


def centre_of(robot: RobotModel) -> np.ndarray:
    """Return the posture (nj,) rad around which a robot's motions are by default."""
    return room_of(robot, rate_hz=100.0, duration=1.0).centre  # the centre depends on neither


def _segment(robot: RobotModel, motion: Motion, control: Control) -> Segment:
    """Return the segment to simulate: the commands of a motion that the controller takes, one per control period.

    Raises:
        UserError: a motion of the flange without an osc controller.
    """
    command = {"q_cmd": motion.q_cmd, "dq_cmd": motion.dq_cmd}
    if control.mode == "osc":
        command = {"ee_cmd": flange_pose(robot, motion.q_cmd) if motion.ee_cmd is None else motion.ee_cmd}
    elif motion.ee_cmd is not None:
        raise UserError("the motion 'osc' moves the flange", key="--control", expected="osc", got=control.mode)
    return Segment(
        control=control,
        tick=1.0 / control.rate_hz,
        command=command,
        q=motion.q_cmd,
        dq=motion.dq_cmd,
        q_raw=motion.q_cmd,
        time=motion.time,
        rows=np.arange(len(motion.time)),
    )
