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
    """One environment of a world's task, a `gymnasium.Env`.

    Args:
        world: a world, a built-in world's name (`vispeg worlds` lists them) or a world file.
        obs_mode: `state`, `proprio`, `depth`, `rgb` or `rgbd`.
        privileged: whether observations hold the ground truth too, as `privileged`, for critics and teachers.
        depth_image: whether depth comes as uint8 images (2 mm a level, 0 = no reading) in place of float32 metres.
        measured: whether observations hold readings in SI units too, as rendered datasets have them.
        render_mode: `rgb_array` for pictures from outside.
        settings: of the task, in place of the world's, such as `steps=60`; see `vispeg.task.config.TaskConfig`.

    Raises:
        UserError: no such world, mode or setting.
    """
    from vispeg.task.environments.env import TaskEnv

    seeing: Any = {"privileged": privileged, "depth_image": depth_image, "measured": measured}
    return TaskEnv(world, obs_mode, render_mode, **seeing, **settings)


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
    """`num_envs` environments that are stepped together, a `gymnasium.vector.VectorEnv`; arguments as in `make`.

    Args:
        num_envs: rows.
        seed: of the first row; row i has seed + i. None: another one every time, told in `infos` of `reset`.
        world, obs_mode, privileged, depth_image, measured, render_mode, settings: as in `make`; `nthread` among the
            settings is the threads of physics.
    """
    from vispeg.task.environments.vector import TaskVec

    seeing: Any = {"privileged": privileged, "depth_image": depth_image, "measured": measured}
    seeing["render_mode"] = render_mode
    return TaskVec(num_envs, world, obs_mode, seed=seed, **seeing, **settings)
