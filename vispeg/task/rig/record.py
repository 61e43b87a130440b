"""Record a simulated robot in its cell, under the task's own controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.cell import LEVER, OPEN_CELL, CellBelief, Outcome, WrenchSensor
from vispeg.recordings.noise import noisy
from vispeg.recordings.recording import Control, Nullspace, Recording
from vispeg.robots.declared import carried
from vispeg.robots.scene import Scene
from vispeg.robots.scene_config import OTHERS, SceneConfig
from vispeg.sim.compiled import flange_pose
from vispeg.sim.rollout import ReadingNoise, rounds
from vispeg.task.belief import Believed, model_cell
from vispeg.task.config import TaskConfig
from vispeg.task.control import DAMPING, POSTURE
from vispeg.task.registry import task_of
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.posture import posture, start_angles
from vispeg.task.rig.run import STEP, Ran, run
from vispeg.worlds.world import World


def controller(
    scene: Scene,
    config: TaskConfig,
    rate_hz: float,
    force_limit: float | None = None,
    stiffness: tuple[float, float] | None = None,
    near: np.ndarray | None = None,
) -> Control:
    """Return the task's controller as a recording states it.

    Args:
        scene: the cell.
        config: settings of its task.
        rate_hz: ticks of the controller per second.
        force_limit, stiffness: of a motion, N and 1/s^2; None for the task's settings.
        near: (nj,) rad, posture for the null space; None for the cell's.
    """
    kp = np.repeat(np.array(stiffness or config.stiffness, float), 3)
    null = Nullspace(POSTURE, DAMPING, posture(scene) if near is None else near)
    limit = scene.nominal.torque_limit
    return Control(
        "osc",
        rate_hz,
        "model",
        kp,
        2 * np.sqrt(kp),
        null,
        config.force_limit if force_limit is None else force_limit,
        limit if np.isfinite(limit).all() else None,
    )


def record_cell(
    world: World,
    motion: CellMotion,
    noise: Mapping[str, float],
    rng: np.random.Generator,
    *,
    rate_hz: float = 500.0,
    torque_sensor: Literal["joint", "none"] = "joint",
    repeat: int = 1,
    name: str = "simulated",
    h_max: float = STEP,
    nthread: int = 1,
    watch: Callable[[np.ndarray], None] = lambda true: None,
) -> Recording:
    """Drive a simulated robot in its cell through a motion and record its sensors.

    Args:
        world: the simulated robot: a model with a cell and effects. The recording states the cell as its belief; the
            world's effects do not appear in it.
        motion: the commanded flange poses, at `rate_hz`.
        noise: standard deviation of white noise on `q`, `dq`, `tau`, `ee`, `ft` and `ft_torque`, added to the recorded
            signals. Exception: if an encoder quantizes, the noise of `q` is added in the loop, before quantization.
        rng: the only source of randomness.
        rate_hz: ticks of the controller, and samples, per second.
        torque_sensor: what `tau` measures; `none` leaves it out.
        repeat: number of runs; several become episodes.
        name: of the recording.
        h_max: greatest physics step, s.
        nthread: threads of the simulation.
        watch: called with the true joint angles (n, nj) rad of the first run, which external cameras can see.

    Raises:
        UserError: the simulation diverges, or the world has no cell.
    """
    belief = _believed(world)
    control = controller(belief.scene, belief.config, rate_hz, motion.force_limit, motion.stiffness, motion.posture)
    q = start_angles(belief.scene, motion.ee_cmd[0], motion.posture)
    plant = belief.world.add(*world.effects)
    sensed = None
    if noise.get("q", 0.0) > 0 and rounds(world):
        sigma = np.full((repeat, len(q)), noise["q"])
        sensed = ReadingNoise(sigma, np.zeros_like(sigma), rng, sensed=True)
    plants = [plant] * (repeat if sensed else 1)
    ran = run(
        belief.scene, plants, control, motion.ee_cmd, q, np.zeros_like(q), h_max=h_max, nthread=nthread, sensed=sensed
    )
    refuse_diverged(ran)
    watch(ran.true[0])
    inserts = motion.name.startswith(("insert", "look", "mix"))  # only an insertion has an outcome
    runs = []
    for row in range(len(plants)):
        outcomes = outcome_of(belief, ran, row) if inserts else ()
        runs.append(
            recording(belief, world, control, ran, motion.ee_cmd, motion.time, name, motion.name, outcomes, row)
        )
    return with_noise(runs if sensed else runs * repeat, noise, rng, torque_sensor, sensed is not None)


def refuse_diverged(ran: Ran) -> None:
    """Raise UserError if a run diverged."""
    if ran.diverged.any():
        raise UserError("the arm does not follow: the loop is unstable", expected="smaller effects or a higher rate")


def recording(
    belief: Believed,
    world: World,
    control: Control,
    ran: Ran,
    ee_cmd: np.ndarray,
    time: np.ndarray,
    name: str,
    motion: str,
    outcomes: tuple[Outcome, ...] = (),
    row: int = 0,
) -> Recording:
    """Return a run as a recording without noise.

    Args:
        belief: the cell as the robot's user believes it to be.
        world: the simulated robot.
        control: the controller that ran.
        ran: runs side by side.
        ee_cmd: (n, 7) commanded flange poses, m and w x y z.
        time: (n,) s.
        name, motion: names of the recording and of its motion.
        outcomes: of the run.
        row: which of the runs.
    """
    scene = belief.scene
    return Recording(
        path=Path(name),
        robot=str(Path(world.robot).resolve()) if Path(world.robot).suffix else world.robot,
        joints=scene.joints,
        rate_hz=control.rate_hz,
        control=control,
        time=time,
        q=ran.q[row],
        dq=ran.dq[row],
        tau=ran.tau[row],
        ee=flange_pose(scene.nominal, ran.q[row]),
        ee_cmd=ee_cmd,
        ft=ran.ft[row],
        tool=carried(scene.nominal.compile()) | {"name": f"{belief.config.robot.tool} and {scene.held}"},
        torque_sensor="joint",
        cell=stated(world.cell, belief),
        wrench=WrenchSensor(),
        outcomes=outcomes,
        motion=motion,
        notes="simulated",
    )


def stated(cell: CellBelief | None, belief: Believed) -> CellBelief:
    """Return the cell for a recording to state; an open cell is replaced by the numbers of the cell that was built."""
    if cell is not None and not cell.open:
        return cell
    return CellBelief("", stated_cell(belief.config))


def stated_cell(config: TaskConfig) -> dict[str, Any]:
    """Return the numbers of a cell as keys of a world file's `task`, without empty values."""
    numbers = {f: getattr(config, f) for f in asdict(SceneConfig()) if f not in OTHERS and hasattr(config, f)}
    return {k: list(v) if isinstance(v, tuple) else v for k, v in numbers.items() if v not in ("", ())}


def with_noise(
    runs: Sequence[Recording],
    noise: Mapping[str, float],
    rng: np.random.Generator,
    torque_sensor: Literal["joint", "none"],
    sensed: bool = False,
) -> Recording:
    """Return runs of one motion as one recording with noise; several runs become episodes.

    Args:
        runs: recordings without noise, of equal length.
        noise: standard deviations, as for `record_cell`.
        rng: the source of randomness.
        torque_sensor: `none` leaves `tau` out.
        sensed: whether the angles already have their noise.
    """
    rec, repeat = runs[0], len(runs)
    names = ["q", "dq", "ee", "ft"] + (["tau"] if torque_sensor != "none" else [])
    level = dict(noise)
    if "ft" in level:
        level.setdefault("ft_torque", LEVER * level["ft"])
    added = {key: value for key, value in level.items() if not (sensed and key == "q")}
    read = [{key: noisy(key, getattr(run, key), added, rng) for key in names} for run in runs]
    columns = {key: np.concatenate([r[key] for r in read]) for key in names}
    if rec.ee_cmd is not None:
        columns["ee_cmd"] = np.tile(rec.ee_cmd, (repeat, 1))
    if repeat > 1:
        columns["episode"] = np.repeat(np.arange(repeat), len(rec.time))
    stated_noise = {key: float(level[key]) for key in (*names, "ft_torque") if level.get(key, 0.0) > 0}
    outcomes = tuple(replace(o, episode=k) for k, run in enumerate(runs) for o in run.outcomes)
    tau = {} if torque_sensor != "none" else {"tau": None}
    time = np.tile(rec.time, repeat)
    return replace(rec, **columns, **tau, time=time, noise=stated_noise, torque_sensor=torque_sensor, outcomes=outcomes)


def _believed(world: World) -> Believed:
    if world.cell is None:
        raise UserError(
            "a motion of a cell needs one", key="model", expected=f"{OPEN_CELL}, a world or a model with `cell`"
        )
    return model_cell(world)


def outcome_of(belief: Believed, ran: Ran, row: int = 0) -> tuple[Outcome, ...]:
    """Return the outcome of the run `row`, judged by its depth and its peak contact force."""
    config, tip, peak = belief.config, ran.tip[row], float(ran.touch[row].max())
    over = np.hypot(tip[:, 0], tip[:, 1]) < 0.5 * belief.scene.config.diameter
    depth = float(np.max(-tip[over, 2], initial=0.0))
    if peak > config.force_abort:
        return (Outcome(False, 0, "force limit", peak, depth),)
    deep = depth >= -float(task_of(config).goal(config)[2])
    return (Outcome(deep, 0, "success" if deep else "search" if depth < 0.002 else "jam", peak, depth),)
