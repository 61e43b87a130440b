"""Motions in a cell, by name or from a table, and their recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from vispeg.api.inputs import read_model
from vispeg.api.recording.look import DURATION as LOOK_S
from vispeg.api.recording.look import pictures_of, refuse_rate, scene_of
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.identify.excitation import MOTIONS as JOINT
from vispeg.identify.excitation import motion as excitation
from vispeg.identify.motions.look_motion import LOOKS, look_motion
from vispeg.recordings.columns import columns_of
from vispeg.recordings.recording import Recording
from vispeg.render.backends.backend import BackendName
from vispeg.render.cameras.camera import Camera
from vispeg.robots.model import load
from vispeg.task.belief import model_cell
from vispeg.task.registry import FIRST, task, task_of
from vispeg.task.rig import table
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.expert import EXPERT, record_expert
from vispeg.task.rig.motions import motion
from vispeg.task.rig.record import record_cell
from vispeg.worlds.world import World

JOINT_S = 5.0  # s, default duration of joint motions


def motions_of(world: World | None = None) -> tuple[str, ...]:
    """Return the names of the motions for a world's cell, or for the built-in task without one, and `expert`."""
    offered = task(FIRST) if world is None or world.cell is None else task_of(model_cell(world).config)
    return *offered.motions, EXPERT


def cell_motion(
    world: World, name: str, *, rate_hz: float = 500.0, seed: int = 0, force_limit: float | None = None
) -> CellMotion:
    """Return a commanded motion for the cell of a world, by name or from a table.

    Args:
        world: a world with a cell.
        name: name of a motion, or a .csv or .parquet file with `time` and `ee_cmd` columns.
        rate_hz: control rate, Hz.
        seed: seed of small variations of places, forces and speeds.
        force_limit: force limit, N, in place of the motion's.

    Raises:
        UserError: no such motion or file, or a motion that the arm cannot make.
    """
    cell = model_cell(world)
    if Path(name).suffix:
        return table.read(Path(name), cell.scene.joints, rate_hz, force_limit)
    paths = task_of(cell.config).motions
    if name not in paths:
        raise UserError("not a motion of a cell", key="--motion", got=name, choices=(*paths, EXPERT))
    commanded = motion(name, cell.scene, cell.config, rate_hz, stream(seed, "record", name), paths)
    return commanded if force_limit is None else replace(commanded, force_limit=force_limit)


def record_in_cell(
    world: World,
    name: str,
    noise: Mapping[str, float],
    *,
    rate_hz: float = 500.0,
    seed: int = 0,
    force_limit: float | None = None,
    torque_sensor: Literal["joint", "none"] = "joint",
    repeat: int = 1,
    label: str = "simulated",
    cameras: Sequence[Camera] = (),
    fps: float = 3.0,
    backend: BackendName = "auto",
    progress: Callable[[float], None] = lambda share: None,
) -> Recording:
    """Record a motion in a world with a cell; see `record_cell`.

    The motion `expert` is a whole episode of the scripted policy.

    With `cameras`, each also takes pictures at `fps` Hz, rendered by `backend`; `progress` is called with the share of
    pictures taken. Pictures show the arm at its true angles; compliance of grip and fixture is too small to be visible.

    Raises:
        UserError: as for `record_cell`, or pictures of `expert` or of several runs.
    """
    rng = stream(seed, "record", "noise")
    if cameras and (name == EXPERT or repeat > 1):
        raise UserError("pictures need a single run of a motion", key="--cameras", got=[c.name for c in cameras])
    options = {"rate_hz": rate_hz, "torque_sensor": torque_sensor, "repeat": repeat, "name": label}
    if name == EXPERT:
        return record_expert(world, seed, noise, rng, **options)
    commanded = cell_motion(world, name, rate_hz=rate_hz, seed=seed, force_limit=force_limit)
    if not cameras:
        return record_cell(world, commanded, noise, rng, **options)
    refuse_rate(fps, rate_hz, float(commanded.time[-1]), cameras)
    truth: list[np.ndarray] = []
    rec = record_cell(world, commanded, noise, rng, **options, watch=truth.append)
    drawing = {"seed": seed, "backend": backend, "progress": progress}
    scene = scene_of(world, cameras)
    return replace(rec, frames=pictures_of(world, scene, cameras, rec, truth[0], fps, rng, **drawing))


def names(space: str | None = None, model: str | None = None) -> list[str]:
    """Return the names of motions for a model, all or those of one `space`.

    The spaces are `joint`, `contact`, and `cell`: the motions for cameras.
    """
    world = None if model is None else read_model(model)
    contact = [name for name in motions_of(world) if name != EXPERT]  # this one is a policy, not a path
    spaces = {"joint": [*JOINT], "contact": contact, "cell": [*LOOKS]}
    return [name for key, group in spaces.items() if space in (None, key) for name in group]


def commands(
    model: str, name: str, *, rate_hz: float, seed: int, duration: float | None
) -> tuple[str, float, CellMotion | None]:
    """Return a motion as a CSV that a robot can replay.

    Args:
        model: the model of the robot or cell.
        name: one of `names(model=model)`.
        rate_hz: rate of commands, Hz.
        seed: seed of the motion.
        duration: duration of a joint motion or a motion for cameras, s.

    Returns:
        The text of the CSV, its duration, s, and for motions in contact the motion with the intended controller.

    Raises:
        UserError: no such motion or model, or one that the arm cannot make.
    """
    world = read_model(model)
    # a name that joint and contact motions share, as `mix`, is the contact motion for a model with a cell
    if name in motions_of(world) and (world.cell is not None or name not in JOINT):
        commanded, cell = cell_motion(world, name, rate_hz=rate_hz, seed=seed), model_cell(world)
        stiffness = commanded.stiffness or cell.config.stiffness
        force_limit = commanded.force_limit or cell.config.force_limit
        commanded = replace(commanded, stiffness=stiffness, force_limit=force_limit)
        return table.text(commanded, cell.scene.joints), float(commanded.time[-1]), commanded
    if name in LOOKS:
        scene = scene_of(world)
        joints, moved = scene.joints, look_motion(name, scene, rate_hz, LOOK_S if duration is None else duration)
    else:
        robot = load(world.robot, tool=world.tool)
        joints = robot.joints
        seconds = JOINT_S if duration is None else duration
        moved = excitation(name, robot, rate_hz, seconds, stream(seed, "record", name))
    head = ["time", *columns_of("q_cmd", joints), *columns_of("dq_cmd", joints)]
    rows = np.column_stack([moved.time, moved.q_cmd, moved.dq_cmd])
    lines = [",".join(head), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    return "\n".join(lines) + "\n", float(moved.time[-1]), None
