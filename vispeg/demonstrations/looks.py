"""Several looks of every state that an environment shows: one row of a batch is seen by further eyes beside its own.

The further eyes draw what only is seen (looks, cameras, sensors and their noise) from other seeds, as `vispeg render
--looks` does; physics, measurements and ground truth are the one simulation's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.datasets.plan import look_seed
from vispeg.demonstrations.plan import seen_world
from vispeg.task.eyes import CameraRig


class OtherLook:
    """A simulation as eyes know it, its episodes in their `look`-th look."""

    def __init__(self, sim: Any, look: int):
        self._sim, self._look = sim, look
        self.world = seen_world(sim.world, sim.config.cameras)
        self.drawn = [self.world] * sim.nsim

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sim, name)

    @property
    def seeds(self) -> list[int]:
        """Of the rows' looks."""
        return [look_seed(int(seed), self._look) for seed in self._sim.seeds]

    def draw(self, rows: np.ndarray) -> None:
        """New worlds for rows whose episodes begin; the guard of contrast may replace them."""
        for row in rows:
            self.drawn[row] = self.world.sample(self.seeds[row], self.scene, self.levels)


class ManyCameraRigs:
    """Eyes and further ones beside them, whose images are called `KEY@1`, `KEY@2` and so on."""

    def __init__(self, own: CameraRig, further: Sequence[CameraRig]):
        self.own, self.further = own, further

    def __getattr__(self, name: str) -> Any:
        return getattr(self.own, name)

    def begin(self, rows: np.ndarray) -> None:
        """See CameraRig."""
        self.own.begin(rows)
        for eyes in self.further:
            eyes.sim.draw(rows)  # type: ignore[attr-defined]
            eyes.begin(rows)

    def look(self, rows: Sequence[int] | np.ndarray) -> None:
        """See CameraRig."""
        for eyes in (self.own, *self.further):
            eyes.look(rows)

    def see(self) -> dict[str, np.ndarray]:
        """See CameraRig."""
        others = {f"{key}@{k}": v for k, eyes in enumerate(self.further, 1) for key, v in eyes.see().items()}
        return self.own.see() | others


def check(env: Any, looks: int) -> None:
    """Raises UserError for more looks than one of an environment without images, or of a world that varies none."""
    eyes: Any = getattr(env, "eyes", None)
    varied = eyes is not None and eyes.cameras and seen_world(env.sim.world, env.sim.config.cameras).ranges
    if looks > 1 and not varied:
        raise UserError("all looks would be the same: nothing that is seen varies", key="looks", expected=1, got=looks)


@contextmanager
def looking(env: Any, looks: int) -> Iterator[None]:
    """Inside, the observations of a PegInHoleVec hold its images in this many looks; it has to be reset at first.

    Raises:
        UserError: as `check`.
    """
    check(env, looks)
    if looks == 1:
        yield
        return
    own: Any = env.eyes
    sims: list[Any] = [OtherLook(env.sim, k) for k in range(1, looks)]
    further = [CameraRig(sim, env.obs_mode, env.file, own.backend) for sim in sims]
    env.eyes = ManyCameraRigs(own, further)
    try:
        yield
    finally:
        env.eyes = own
        for eyes in further:
            eyes.close()


def side_by_side(obs: Mapping[str, np.ndarray], looks: int) -> dict[str, np.ndarray]:
    """(n, ...) observations in several looks -> (looks n, ...), look after look; what is no image stands in each."""
    keys = [key for key in obs if "@" not in key]
    return {key: np.concatenate([obs.get(f"{key}@{k}", obs[key]) for k in range(looks)]) for key in keys}
