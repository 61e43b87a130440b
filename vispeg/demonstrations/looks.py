"""Several looks of every state that an environment shows: its rows are seen by further cameras beside its own.

The further ones draw what is only seen (looks, cameras, sensors and their noise) from other seeds, as `vispeg render
--looks` does; physics, measurements and ground truth are the one simulation's.
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
    """Raise UserError for more looks than one of an environment without images, or of a world that varies none."""
    eyes = getattr(env, "eyes", None)
    if looks > 1 and not (eyes is not None and eyes.varied):
        raise UserError("all looks would be the same: nothing that is seen varies", key="looks", expected=1, got=looks)


@contextmanager
def looking(env: TaskVec, looks: int) -> Iterator[None]:
    """Inside, the observations of an environment hold its images in this many looks; it has to be reset at first.

    The images of the k-th further look are called `KEY@k`.

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
    """(n, ...) observations in several looks -> (looks n, ...), look after look; what is no image stands in each."""
    keys = [key for key in obs if "@" not in key]
    return {key: np.concatenate([obs.get(f"{key}@{k}", obs[key]) for k in range(looks)]) for key in keys}
