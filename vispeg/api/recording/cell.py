"""Motions of a cell and their recordings, by name or from a table, in any belief."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from vispeg.api.inputs import read_model
from vispeg.api.recording.look import DURATION as LOOK_S
from vispeg.api.recording.look import refuse_rate, scene_of, taken
from vispeg.core.effect import OPTICAL, effect
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

JOINT_S = 5.0  # s that motions of joints take


def motions_of(world: World | None = None) -> tuple[str, ...]:
    """Names of the motions of a world's cell, those of the package's own task without a cell, and of its expert."""
    offered = task(FIRST) if world is None or world.cell is None else task_of(model_cell(world).config)
    return *offered.motions, EXPERT


def cell_motion(
    world: World, name: str, *, rate_hz: float = 500.0, seed: int = 0, force_limit: float | None = None
) -> CellMotion:
    """Give a commanded motion for the cell that a world believes in: one of the package's by name, or a table's.

    Args:
        world: with a cell.
        name: of a motion, or a .csv or .parquet file with `time` and `ee_cmd` columns.
        rate_hz: ticks a second.
        seed: shifts places, forces and speeds a little.
        force_limit: N, in place of the motion's own.

    Raises:
        UserError: no such motion or file; one that the arm cannot make.
    """
    belief = model_cell(world)
    if Path(name).suffix:
        return table.read(Path(name), belief.scene.joints, rate_hz, force_limit)
    paths = task_of(belief.config).motions
    if name not in paths:
        raise UserError("not a motion of a cell", key="--motion", got=name, choices=(*paths, EXPERT))
    made = motion(name, belief.scene, belief.config, rate_hz, stream(seed, "record", name), paths)
    return made if force_limit is None else replace(made, force_limit=force_limit)


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
    """Give a recording of a world with a cell; see `record_cell`. `expert` is a whole episode under the scripted
    policy.

    With `cameras` there are pictures too: `fps` a second of each, drawn by `backend`; `progress` is called with the
    share of them that is taken. They show the arm where it was; what gives way in grip and fixture is too small to
    be drawn.

    Raises:
        UserError: as `record_cell`, and for pictures of `expert` or of several runs.
    """
    rng = stream(seed, "record", "noise")
    if cameras and (name == EXPERT or repeat > 1):
        raise UserError("pictures of one run of a motion only", key="--cameras", got=[c.name for c in cameras])
    options = {"rate_hz": rate_hz, "torque_sensor": torque_sensor, "repeat": repeat, "name": label}
    if name == EXPERT:
        return record_expert(world, seed, noise, rng, **options)
    made = cell_motion(world, name, rate_hz=rate_hz, seed=seed, force_limit=force_limit)
    if not cameras:
        return record_cell(world, made, noise, rng, **options)
    refuse_rate(fps, rate_hz, float(made.time[-1]), cameras)
    truth: list[np.ndarray] = []
    felt = world.only(lambda e: effect(e.effect).family not in OPTICAL)
    rec = record_cell(felt, made, noise, rng, **options, watch=truth.append)
    drawing = {"seed": seed, "backend": backend, "progress": progress}
    return replace(rec, frames=taken(world, scene_of(world, cameras), cameras, rec, truth[0], fps, rng, **drawing))


def names(space: str | None = None, model: str | None = None) -> list[str]:
    """Names of commanded paths, of a model's cell: all, or those of one space (`joint`, `contact`, `cell`)."""
    world = None if model is None else read_model(model)
    spaces = {"joint": [*JOINT], "contact": [*motions_of(world)[:-1]], "cell": [*LOOKS]}
    return [name for key, some in spaces.items() if space in (None, key) for name in some]


def commands(
    model: str, name: str, *, rate_hz: float, seed: int, duration: float | None
) -> tuple[str, float, CellMotion | None]:
    """Give a motion as the text of a CSV that a robot can replay, how long it takes, s, and in a cell the motion with
    the controller that it is made for; `duration` of those of joints.

    Raises:
        UserError: no such motion or model, or one that the arm cannot make.
    """
    world = read_model(model)
    if name in motions_of(world) and (world.cell is not None or name not in JOINT):
        made, belief = cell_motion(world, name, rate_hz=rate_hz, seed=seed), model_cell(world)
        held = made.stiffness or belief.config.stiffness
        made = replace(made, stiffness=held, force_limit=made.force_limit or belief.config.force_limit)
        return table.text(made, belief.scene.joints), float(made.time[-1]), made
    if name in LOOKS:
        scene = scene_of(world)
        joints, joint = scene.joints, look_motion(name, scene, rate_hz, duration or LOOK_S)
    else:
        robot = load(world.robot, tool=world.tool)
        joints = robot.joints
        joint = excitation(name, robot, rate_hz, duration or JOINT_S, stream(seed, "record", name))
    head = ["time", *columns_of("q_cmd", joints), *columns_of("dq_cmd", joints)]
    rows = np.column_stack([joint.time, joint.q_cmd, joint.dq_cmd])
    lines = [",".join(head), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    return "\n".join(lines) + "\n", float(joint.time[-1]), None
