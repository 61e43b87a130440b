"""Render every state of an environment in several looks.

Each further look has its own camera rig, which draws what only cameras see (appearance, cameras, sensors and their
noise) from another seed, as `vispeg render --looks` does. Physics, measurements and ground truth are shared.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.datasets.shards.plan import look_seed

if TYPE_CHECKING:
    from vispeg.task.environments.vector import TaskVec


def check(env: Any, looks: int) -> None:
    """Raise UserError for several looks where all would be equal: without images, or where nothing seen varies."""
    eyes = getattr(env, "eyes", None)
    if looks > 1 and not (eyes is not None and eyes.varied):
        raise UserError("all looks would be the same: nothing that is seen varies", key="looks", expected=1, got=looks)


@contextmanager
def looking(env: TaskVec, looks: int) -> Iterator[None]:
    """Make an environment's observations hold its images in this many looks while the body runs.

    Reset the environment first thing in the body. The key of an image in the k-th further look is `KEY@k`, k >= 1.

    Raises:
        UserError: as `check`.
    """
    check(env, looks)
    if looks == 1:
        yield
        return
    env.further = [env.rig(partial(look_seed, look=k)) for k in range(1, looks)]
    try:
        yield
    finally:
        further, env.further = env.further, []
        for rig in further:
            rig.close()


def side_by_side(obs: Mapping[str, np.ndarray], looks: int) -> dict[str, np.ndarray]:
    """Return observations (n, ...) with images in several looks as (looks * n, ...), one look after the other.

    Values that are not images are repeated for each look.
    """
    keys = [key for key in obs if "@" not in key]
    return {key: np.concatenate([obs.get(f"{key}@{k}", obs[key]) for k in range(looks)]) for key in keys}
