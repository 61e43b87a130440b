"""Describe what a task's policies observe and how their actions are meant, for use without the simulator."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from vispeg.interface.interface import OFFSET, Arm, Controller, Goal, Interface, Seen, Told, Tool
from vispeg.render.cameras.camera import Camera
from vispeg.render.image_kinds import GOAL_TOLD, MODES, camera_of, kind_of
from vispeg.robots.declared import carried
from vispeg.robots.scene import Scene
from vispeg.task.config import TaskConfig
from vispeg.task.contract import Task
from vispeg.task.control import DAMPING, POSTURE
from vispeg.task.eyes import task_cameras
from vispeg.task.kinematics import chain_of, tool_weight
from vispeg.task.registry import task_of
from vispeg.task.rig.posture import posture
from vispeg.task.rig.record import stated_cell
from vispeg.task.terms import Observation
from vispeg.task.world_file import WorldFile


def interface_in(
    config: TaskConfig, file: WorldFile | None, obs_mode: str, images: Iterable[str] | None = None, **origin: Any
) -> Interface:
    """Return the Interface of a policy in a world: the meaning of its observations and actions.

    Args:
        config: settings of the world's task.
        file: the world's file, which may change cameras; or None.
        obs_mode: observation mode.
        images: keys of the images that the policy sees; None for all of the mode.
        **origin: as in `interface_of`.
    """
    kinds = MODES[obs_mode]
    scene = task_of(config).cell(config, config.cameras if kinds else ())
    cameras = task_cameras(scene, config, file.cameras if file is not None else {}) if kinds else ()
    every = [f"{kind.name}_{c.name}" for c in cameras for kind in kinds]
    return interface_of(config, scene, obs_mode, cameras, every if images is None else images, **origin)


def interface_of(
    config: TaskConfig, scene: Scene, obs_mode: str, cameras: Sequence[Camera], images: Iterable[str], **origin: Any
) -> Interface:
    """Return the Interface of a task's policies: the meaning of their observations and actions.

    Args:
        config: settings of the task.
        scene: its cell.
        obs_mode: observation mode.
        cameras: the cameras, as calibrated.
        images: keys of the images that the policies see.
        **origin: further fields of Interface: `modality`, `recurrent`, `policy`, and those of the worlds.
    """
    offered, arm = task_of(config), scene.nominal
    own = type(offered).command is not Task.command
    eyes = {c.name: c for c in cameras}
    kp = np.repeat(config.stiffness, 3)
    home, load = posture(scene), carried(arm.compile())
    seen = {}
    for key in images:
        kind = kind_of(key)
        if kind is not None:
            eye = eyes[camera_of(key)]
            shape = kind.shape(eye.height, eye.width)
            seen[key] = Seen(kind=kind.name, unit=kind.unit, shape=shape, camera=asdict(eye))
    return Interface(
        task=config.name,
        title=offered.title,
        told=tuple(
            Told(name=t.name, size=t.length(config), unit=t.unit, scale=t.scale, about=t.about)
            for t in Observation(offered.terms, config).policy
        ),
        stack=config.stack,
        images=seen,
        dof=config.dof,  # type: ignore[arg-type]  # TaskConfig refuses other directions
        offset_m=config.offset,
        turn_rad=config.turn,
        law=f"{type(offered).__module__}:{type(offered).__qualname__}.command" if own else OFFSET,
        policy_period_s=config.policy_period,
        steps=config.steps,
        arm=Arm(
            robot=arm.name,
            joints=arm.joints,
            low_rad=tuple(arm.range[:, 0].tolist()),
            high_rad=tuple(arm.range[:, 1].tolist()),
            velocity_limit=tuple(arm.velocity_limit.tolist()),
            torque_limit=tuple(arm.torque_limit.tolist()),
            home_rad=tuple(home.tolist()),
            chain=dict(chain_of(arm).to_json()),
        ),
        tool=Tool(
            name=f"{config.robot.tool} and {scene.held}",
            tip_m=scene.tip,
            weight_n=tuple(tool_weight(scene).tolist()),
            mass_kg=load["mass_kg"],
            com_m=tuple(load["com_m"]),
            inertia_kgm2=tuple(load["inertia_kgm2"]),
        ),
        goal=Goal(
            nominal_m=tuple(map(float, scene.target)),
            told=obs_mode in GOAL_TOLD,
            reached_m=tuple(np.asarray(offered.goal(config), float).tolist()),
            within_m=offered.within(config),
            cell=stated_cell(config),
        ),
        controller=Controller(
            period_s=config.control_period,
            kp=tuple(kp.tolist()),
            kd=tuple((2 * np.sqrt(kp)).tolist()),
            force_limit_n=config.force_limit,
            nullspace={"kp": POSTURE, "kd": DAMPING, "q": home.tolist()},
            avoid_limits=config.avoid_limits,
        ),
        force_abort_n=config.force_abort,
        start_height_m=config.start_height,
        start_radius_m=config.start_radius,
        **origin,
    )
