"""Replay of dictionaries of observations, in which every frame stands once.

Each of N environments owns a ring of T entries (observation, action, reward). The observation after entry i is entry i
+ 1, so a frame is not stored again as its predecessor's successor; an episode's last observation gets an entry of its
own, from which no transition starts. Entries of one episode lie in order, so that sequences for recurrent policies are
slices.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from vispeg.core.errors import UserError
from vispeg.core.memory import available, in_words
from vispeg.core.seeds import stream
from vispeg.render.image_kinds import kind_of

SHARE = 0.9  # of free memory that a ring may take: networks and environments take some too
Images = Literal["before", "after", "both", "none"]


@dataclass(frozen=True)
class Batch:
    """Transitions. Arrays have leading axes (n,), or (time, n) for sequences.

    Attributes:
        obs, next_obs: by key.
        action: (..., action) within +-1.
        reward: (...).
        done: (...), 1 where the episode ended for good, 0 where it went on or was cut by its time limit.
        weight: (...), 1 where there is a transition; 0 past an episode's end in a sequence.
    """

    obs: dict[str, Tensor]
    next_obs: dict[str, Tensor]
    action: Tensor
    reward: Tensor
    done: Tensor
    weight: Tensor


class Replay:
    """A ring of transitions with the constructor and `add` that Stable-Baselines3 expects of a replay buffer.

    Args:
        buffer_size: entries over all environments.
        observation_space: gymnasium Dict: vectors, `depth_*` (float32 metres, kept in steps of 0.05 mm), `rgb_*`
            (uint8).
        action_space: gymnasium Box.
        device: where batches go.
        n_envs: environments.
        optimize_memory_usage: of no effect; memory is always used once.
        seed: of the draws.
    """

    def __init__(
        self,
        buffer_size: int,
        observation_space: Any,
        action_space: Any,
        device: torch.device | str = "cpu",
        n_envs: int = 1,
        optimize_memory_usage: bool = False,
        seed: int = 0,
    ):
        self.length, self.n_envs, self.device = max(buffer_size // n_envs, 2), n_envs, torch.device(device)
        self.observation_space, self.action_space = observation_space, action_space
        self.rng = stream(seed, "replay")
        rows = (self.length, n_envs)
        self.obs = {
            key: np.zeros((*rows, *space.shape), _stored(key, space.dtype))
            for key, space in observation_space.spaces.items()
        }
        self.action = np.zeros((*rows, *action_space.shape), np.float32)
        self.reward = np.zeros(rows, np.float32)
        self.done = np.zeros(rows, np.float32)
        self.starts = np.zeros(rows, bool)  # whether a transition starts here whose end is stored too
        self.head = np.zeros(n_envs, np.int64)  # where the next entry goes
        self.open = np.full(n_envs, -1, np.int64)  # the entry that waits for its successor, -1 for none
        self.began = np.zeros(n_envs, np.int64)  # where the present episode began
        self.full, self.refused = False, 0

    @staticmethod
    def size(entries: int, observation_space: Any, action_space: Any) -> int:
        """Bytes of a ring of that many entries."""
        each = sum(
            int(np.prod(space.shape)) * np.dtype(_stored(key, space.dtype)).itemsize
            for key, space in observation_space.spaces.items()
        )
        return entries * (each + 4 * int(np.prod(action_space.shape)) + 9)  # reward, end, start

    def add(
        self,
        obs: Mapping[str, np.ndarray],
        next_obs: Mapping[str, np.ndarray],
        action: np.ndarray,
        reward: np.ndarray,
        done: np.ndarray,
        infos: Sequence[Mapping[str, Any]],
        keep: np.ndarray | None = None,
    ) -> None:
        """One step of every environment. `next_obs` holds the terminal observation where `done`.

        Where an episode ends whose row is False in `keep` (n,), the whole episode is dropped.

        A transition with anything in it that is not finite is refused, and counted in `refused`; so is one into a
        simulation that `diverged`, whatever its numbers look like.
        """
        fine = np.isfinite(action).all(-1) & np.isfinite(reward)
        fine &= np.array([info.get("category") != "diverged" for info in infos])
        fine &= _finite(obs, self.n_envs) & _finite(next_obs, self.n_envs)
        self.refused += int((~fine).sum())
        envs = np.arange(self.n_envs)
        here = self._write(obs, envs)
        went_on = self.open >= 0
        self.starts[self.open[went_on], envs[went_on]] = True
        self.action[here, envs], self.reward[here, envs] = np.nan_to_num(action), np.nan_to_num(reward)
        cut = np.array([bool(info.get("TimeLimit.truncated", False)) for info in infos])
        self.done[here, envs] = done & ~cut
        self.open = np.where(fine & ~done, here, -1)
        if done.any():
            over = np.flatnonzero(done)
            self._write({key: value[over] for key, value in next_obs.items()}, over)
            self.starts[here[over], over] = fine[over]
            for row in over.tolist():
                if keep is not None and not keep[row]:
                    self.starts[self._span(row), row] = False
            self.began[over] = self.head[over]

    def cut(self) -> None:
        """End the episodes in progress without their last transition: what follows is another episode."""
        self.open[:] = -1
        self.began[:] = self.head

    def _span(self, row: int) -> np.ndarray:
        """Entries of the row's present episode."""
        return (
            np.arange(self.began[row], self.head[row] + self.length * (self.head[row] <= self.began[row])) % self.length
        )

    def _write(self, obs: Mapping[str, np.ndarray], envs: np.ndarray) -> np.ndarray:
        at = self.head[envs]
        for key, stored in self.obs.items():
            stored[at, envs] = _pack(key, obs[key])
        self.starts[at, envs] = False
        self.head[envs] = (at + 1) % self.length
        self.full |= bool((self.head[envs] == 0).any())
        return at

    @property
    def _used(self) -> int:
        """Rows that have ever been written; the ring has gone round where `full`."""
        return self.length if self.full else int(self.head.max())

    def __len__(self) -> int:
        """Give the number of transitions that can be drawn."""
        return int(self.starts.sum())

    def sample(self, n: int, rng: np.random.Generator | None = None, images: Images = "both") -> Batch:
        """Draws n transitions uniformly with replacement.

        Args:
            n: how many.
            rng: of the draws; by default the ring's own.
            images: which images are fetched: those `before` the transition, `after` it, `both` or `none`.

        Raises:
            UserError: there is none yet.
        """
        at, env = self._draw(n, self.starts, rng or self.rng)
        return self._batch(at, env, images=images)

    def sequences(self, n: int, steps: int, rng: np.random.Generator | None = None) -> Batch:
        """Draws n episodes (steps, n, ...) from their beginning; what follows an episode's end has weight 0."""
        first = self.starts & ~np.roll(self.starts, 1, axis=0)
        at, env = self._draw(n, first, rng or self.rng)
        at = (at + np.arange(steps)[:, None]) % self.length  # (steps, n)
        weight = np.logical_and.accumulate(self.starts[at, env], axis=0)
        return self._batch(at, np.broadcast_to(env, at.shape), weight)

    def _draw(self, n: int, allowed: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        if not allowed.any():
            raise UserError("nothing to learn from: the replay holds no transition")
        indices = np.empty(0, np.int64)
        while len(indices) < n:  # nearly all entries may be drawn, so one round is enough; of episodes' starts, few may
            drawn = rng.integers(0, self._used * self.n_envs, 2 * n if allowed is self.starts else 64 * n)
            indices = np.concatenate([indices, drawn[allowed.reshape(-1)[drawn]]])
        return np.divmod(indices[:n], self.n_envs)

    def _batch(
        self, at: np.ndarray, env: np.ndarray, weight: np.ndarray | None = None, images: Images = "both"
    ) -> Batch:
        after = (at + 1) % self.length
        ones = np.ones(at.shape, np.float32) if weight is None else weight.astype(np.float32)
        return Batch(
            {key: self._tensor(key, self.obs[key][at, env]) for key in self._keys(images in ("before", "both"))},
            {key: self._tensor(key, self.obs[key][after, env]) for key in self._keys(images in ("after", "both"))},
            *(
                torch.from_numpy(a).to(self.device)
                for a in (self.action[at, env], self.reward[at, env], self.done[at, env], ones)
            ),
        )

    def _keys(self, images: bool) -> list[str]:
        return [key for key in self.obs if images or kind_of(key) is None]

    def _tensor(self, key: str, packed: np.ndarray) -> Tensor:
        kind = kind_of(key)
        return torch.from_numpy(packed if kind is None else kind.unpack(packed)).to(self.device)

    def save(self, folder: Path) -> None:
        """Write the ring as one .npy an array, so that no more than the file's own size is in memory."""
        for name, array in self._arrays().items():
            np.save(folder / f"{name}.npy", array[: self._used] if array.ndim > 1 else array)

    def load(self, folder: Path) -> None:
        """Read what `save` wrote into a ring of the same shapes.

        Raises:
            UserError: a file is missing, or is from a ring of other shapes.
        """
        for name, array in self._arrays().items():
            path = folder / f"{name}.npy"
            try:
                stored = np.load(path, mmap_mode="r", allow_pickle=False)
            except (OSError, ValueError) as error:
                raise UserError("not a stored replay", file=path) from error
            if stored.shape[1:] != array.shape[1:] or len(stored) > len(array) or stored.dtype != array.dtype:
                raise UserError("from a replay of another shape", file=path, expected=array.shape, got=stored.shape)
            array[: len(stored)] = stored
        self.full = len(np.load(folder / "reward.npy", mmap_mode="r", allow_pickle=False)) == self.length

    def _arrays(self) -> dict[str, np.ndarray]:
        arrays = {name: getattr(self, name) for name in ("action", "reward", "done", "starts", "head", "open", "began")}
        return arrays | {f"obs.{key}": stored for key, stored in self.obs.items()}


def afford(entries: int, observation_space: Any, action_space: Any, key: str, what: str) -> str:
    """Give the memory that a ring will take, in words, before it takes it: pages come only as they are written.

    Args:
        entries: that will be written.
        observation_space, action_space: as of Replay.
        key: the option that sets its size.
        what: it is, for people.

    Raises:
        UserError: this machine, or the control group of this process, has less.
    """
    need, free = Replay.size(entries, observation_space, action_space), available()
    said = f"{what} of {entries} entries: {in_words(need)}"
    if free is None:
        return said
    if need > SHARE * free:
        fits = int(SHARE * free / need * entries)
        expected = f"{fits} or less, or smaller images (image_size)"
        raise UserError(f"{said}, and {in_words(free)} are free", key=key, expected=expected, got=entries)
    return f"{said} of {in_words(free)} that are free"


def mixed(first: Batch, second: Batch) -> Batch:
    """Both batches' transitions, first ones first."""
    axis = first.reward.ndim - 1  # of transitions; before it may stand an axis of time

    def join(a: Tensor, b: Tensor) -> Tensor:
        return torch.cat([a, b], dim=axis)

    return Batch(
        {key: join(value, second.obs[key]) for key, value in first.obs.items()},
        {key: join(value, second.next_obs[key]) for key, value in first.next_obs.items()},
        *(join(getattr(first, name), getattr(second, name)) for name in ("action", "reward", "done", "weight")),
    )


def _stored(key: str, dtype: Any) -> Any:
    kind = kind_of(key)
    return dtype if kind is None else kind.stored


def _pack(key: str, value: np.ndarray) -> np.ndarray:
    if (kind := kind_of(key)) is not None:
        return kind.pack(value)
    return np.nan_to_num(value) if value.dtype.kind == "f" else value


def _gaps(key: str) -> bool:
    kind = kind_of(key)
    return kind is not None and kind.gaps


def _finite(obs: Mapping[str, np.ndarray], n: int) -> np.ndarray:
    """(n,) whether all vectors are finite; a depth image's NaN only means that there is no reading."""
    fine = np.ones(n, bool)
    for key, value in obs.items():
        if value.dtype.kind == "f" and not _gaps(key):
            fine &= np.isfinite(value.reshape(n, -1)).all(1)
    return fine
