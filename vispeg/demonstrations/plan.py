"""Plan the rendering of a task: what to render, in which cell, and what every frame holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.datasets.layout import (
    Feature,
    Layout,
    colour_of,
    depth,
    depth_of,
    flag,
    number,
    numbers,
    parts,
    picture,
    truth_of,
)
from vispeg.datasets.shards.plan import RGB, RGBD, Plan, shard_frames
from vispeg.effects.common.images import digest
from vispeg.render.cameras.camera import Camera
from vispeg.render.part_mesh import part_mesh
from vispeg.robots.scene import Scene
from vispeg.task import registry
from vispeg.task.config import TaskConfig
from vispeg.task.eyes import task_cameras
from vispeg.task.terms import Observation
from vispeg.task.world_file import WorldFile, load_world
from vispeg.worlds.split import optical

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
TASK_STATE = (
    *("tip_x", "tip_y", "tip_z", "velocity_x", "velocity_y", "velocity_z"),
    *("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z"),
)


def plan_of(
    world: str,
    frames: int,
    *,
    looks: int = 1,
    cameras: Sequence[str] = (),
    size: int = 0,
    seed: int = 0,
    noise: float = 0.2,
    labels: bool = True,
    backend: str = "auto",
    modality: str = RGBD,
) -> tuple[Plan, Layout]:
    """Return the plan for rendering a world's task, and the layout of its frames; see Plan for the arguments.

    Raises:
        UserError: an unknown world or camera, an invalid number, or several looks where nothing seen varies.
    """
    file = load_world(world)
    task = task_of(file, cameras, size)
    used = task_cameras(scene_of(task), task, file.cameras)
    if looks > 1 and not optical(file.world, task.cameras).ranges:
        raise UserError(
            "all looks would be the same: the world varies nothing that is seen", key="looks", expected="1", got=looks
        )
    name = world if world == file.path.stem else str(file.path)  # a built-in world's name, else a path
    plan = Plan(
        name,
        file.hash,
        frames,
        looks,
        tuple(c.name for c in used),
        size,
        seed,
        noise,
        labels,
        str(file.renderer.get("backend", backend)),
        shard_frames=shard_frames(sum(c.width * c.height for c in used)),
        modality=modality,
        images=images_of(file, task.cameras),
    )
    return plan, layout_of(file, task, used, labels, modality != RGB)


def images_of(file: WorldFile, cameras: Sequence[str]) -> str:
    """Return the digest of the images from which a world's looks draw in pictures of these cameras; empty for none.

    They are files of the machine, not of the world, so the world's hash does not hold them.

    Raises:
        UserError: there are no such images, or they cannot be read.
    """
    kinds = {getattr(effect(e.effect), "images", ()) for e in optical(file.world, cameras).entries}
    return " ".join(digest(endings) for endings in sorted(kinds) if endings)


def task_of(file: WorldFile, cameras: Sequence[str], size: int) -> TaskConfig:
    """Return the task of a world's file with these cameras and this image size.

    Args:
        file: the world's file.
        cameras: names of cameras; empty for the task's own.
        size: shorter side of an image, px; 0 for the cameras' own size.

    Raises:
        UserError: unknown cameras, or an impossible size.
    """
    chosen = {"cameras": tuple(cameras)} if cameras else {}
    task = registry.config_of({**file.task, **chosen}, str(file.path))
    try:
        return replace(task, image_size=size)
    except UserError as error:  # the world's file is not to blame
        raise UserError(str(error), key="size") from error


def scene_of(task: TaskConfig) -> Scene:
    """Return the task's cell with the cameras that the task uses, and no others."""
    return replace(registry.task_of(task).cell(task), cameras=task.cameras)


def layout_of(file: WorldFile, task: TaskConfig, cameras: tuple[Camera, ...], labels: bool, deep: bool) -> Layout:
    """Return the layout of a rendered frame, with or without segmentation and depth.

    Raises:
        UserError: a camera's name is another one's with `_depth`, which files use for that one's depth.
    """
    names = {c.name for c in cameras}
    for name in names & {f"{other}_depth" for other in names}:
        what = "a camera has the name of another one's depth"
        raise UserError(what, file=file.path, key="cameras", expected="another name", got=name)
    observed, scene = Observation(registry.task_of(task).terms, task), scene_of(task)
    features: dict[str, Feature] = {
        "observation.state": numbers((*scene.joints, *TASK_STATE)),
        "observation.policy": numbers([f"policy{i}" for i in range(task.stack * observed.policy_size)]),
        truth_of(()): numbers([f"truth{i}" for i in range(observed.truth_size)]),
        "action": numbers(task.dof),
        "executed.action": numbers(task.dof),
        "next.reward": number(),
        "next.done": flag(),
        "next.success": flag(),
        f"label.{scene.goal}": numbers(POSE),
    }
    for c in cameras:
        features[f"label.{scene.held}.{c.name}"] = numbers(POSE)
        features[f"label.camera.{c.name}"] = numbers(POSE)
        features[colour_of(c.name)] = picture(c)
        if deep:
            features[depth_of(c.name, ())] = depth(c)
        if labels:
            features[f"label.parts.{c.name}"] = parts(c)
    sites = {scene.held: scene.tip_site, scene.fixture: scene.goal}
    models = {part: part_mesh(scene, part, site) for part, site in sites.items()}
    return Layout(
        features,
        cameras,
        tuple(scene.parts),
        1 / task.policy_period,
        registry.task_of(task).title,
        scene.name,
        models,
    )
