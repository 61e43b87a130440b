"""`vispeg.make` and `vispeg.make_vec`: the task as gymnasium environments."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from vispeg.worlds.world import World

if TYPE_CHECKING:
    from vispeg.task.environments.env import TaskEnv
    from vispeg.task.environments.vector import TaskVec


def make(
    world: World | str | Path = "nominal",
    obs_mode: str = "state",
    *,
    privileged: bool = False,
    depth_image: bool = False,
    measured: bool = False,
    render_mode: str | None = None,
    **settings: Any,
) -> TaskEnv:
    """Return one environment of a world's task, a `gymnasium.Env`.

    Args:
        world: a world, a built-in world's name (`vispeg worlds` lists them) or a world file.
        obs_mode: `state`, `proprio`, `depth`, `rgb` or `rgbd`.
        privileged: add the ground truth to observations, as `privileged`, for critics and teachers.
        depth_image: give depth as uint8 images (2 mm per level, 0 for no reading) instead of float32 metres.
        measured: add readings in SI units to observations, as in rendered datasets.
        render_mode: `rgb_array` for pictures from outside.
        settings: settings of the task in place of the world's, such as `steps=60`; see `vispeg.task.config.TaskConfig`.

    Raises:
        UserError: no such world, mode or setting.
    """
    from vispeg.task.environments.env import TaskEnv

    return TaskEnv(
        world,
        obs_mode,
        render_mode,
        privileged=privileged,
        depth_image=depth_image,
        measured=measured,
        **settings,
    )


def make_vec(
    num_envs: int,
    world: World | str | Path = "nominal",
    obs_mode: str = "state",
    *,
    seed: int | None = None,
    privileged: bool = False,
    depth_image: bool = False,
    measured: bool = False,
    render_mode: str | None = None,
    **settings: Any,
) -> TaskVec:
    """Return a `gymnasium.vector.VectorEnv` of environments that are stepped together; arguments as in `make`.

    Args:
        num_envs: number of environments (rows).
        seed: seed of row 0; row i has seed + i. With None the seed differs each time; `infos` of `reset` states it.
        world, obs_mode, privileged, depth_image, measured, render_mode, settings: as in `make`; the setting `nthread`
            is the number of threads for physics.
    """
    from vispeg.task.environments.vector import TaskVec

    return TaskVec(
        num_envs,
        world,
        obs_mode,
        seed=seed,
        privileged=privileged,
        depth_image=depth_image,
        measured=measured,
        render_mode=render_mode,
        **settings,
    )
