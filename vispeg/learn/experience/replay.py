"""Replay buffer for dictionaries of observations that stores every frame once.

Each of N environments has a ring of T entries (observation, action, reward). The next observation of entry i is the
observation of entry i + 1, so no frame is stored twice. An episode's last observation gets an entry of its own, from
which no transition starts. Entries of one episode are consecutive, so sequences for recurrent policies are slices.
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

SHARE = 0.9  # largest share of free memory for a ring; networks and environments need the rest
BETWEEN, REFUSED = -1, -2
Images = Literal["before", "after", "both", "none"]


@dataclass(frozen=True)
class Batch:
    """A batch of transitions. Arrays have leading axes (n,), or (time, n) for sequences.

    Attributes:
        obs, next_obs: observations before and after the transition, by key.
        action: (..., action) within +-1.
        reward: (...).
        done: (...), 1 where the episode terminated, 0 where it continued or only its time limit ended it.
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
        buffer_size: number of entries over all environments.
        observation_space: gymnasium Dict: vectors, `depth_*` (float32 metres, kept in steps of 0.05 mm), `rgb_*`
            (uint8).
        action_space: gymnasium Box.
        device: torch device of the batches.
        n_envs: number of environments.
        optimize_memory_usage: without effect; Stable-Baselines3 passes it.
        seed: seed of the draws.
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
        self.starts = np.zeros(rows, bool)  # whether a complete transition starts at this entry
        self.first = np.zeros(rows, bool)  # whether an episode begins at this entry
        self.head = np.zeros(n_envs, np.int64)  # index of the next entry to write
        # index of the entry whose next observation is awaited, BETWEEN episodes or after one that was REFUSED
        self.open = np.full(n_envs, BETWEEN, np.int64)
        self.began = np.zeros(n_envs, np.int64)  # index of the present episode's first entry
        self.full, self.refused = False, 0

    @staticmethod
    def size(entries: int, observation_space: Any, action_space: Any) -> int:
        """Return the size of a ring of that many entries, bytes."""
        each = sum(
            int(np.prod(space.shape)) * np.dtype(_stored(key, space.dtype)).itemsize
            for key, space in observation_space.spaces.items()
        )
        return entries * (each + 4 * int(np.prod(action_space.shape)) + 10)  # reward, end, start, first

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
        """Add one step of every environment.

        A transition with a value that is not finite, or in a simulation that diverged, is refused and counted in
        `refused`.

        Args:
            obs, next_obs: observations before and after the step, arrays (n, ...); `next_obs` holds an episode's last
                observation where `done`.
            action: (n, action) within +-1.
            reward: (n,).
            done: (n,) bool, whether the episode ended with this step.
            infos: info of each row, with `TimeLimit.truncated` where only the time limit ended the episode, and
                `category`.
            keep: (n,) bool; an episode that ends in a row where this is False is dropped as a whole. None to keep all.
        """
        fine = np.isfinite(action).all(-1) & np.isfinite(reward)
        fine &= np.array([info.get("category") != "diverged" for info in infos])
        fine &= _finite(obs, self.n_envs) & _finite(next_obs, self.n_envs)
        self.refused += int((~fine).sum())
        envs = np.arange(self.n_envs)
        here = self._write(obs, envs)
        went_on = self.open >= 0
        self.starts[self.open[went_on], envs[went_on]] = True
        self.first[here, envs] = self.open == BETWEEN
        self.action[here, envs], self.reward[here, envs] = np.nan_to_num(action), np.nan_to_num(reward)
        cut = np.array([bool(info.get("TimeLimit.truncated", False)) for info in infos])
        self.done[here, envs] = done & ~cut
        self.open = np.where(done, BETWEEN, np.where(fine, here, REFUSED))
        if done.any():
            over = np.flatnonzero(done)
            self._write({key: value[over] for key, value in next_obs.items()}, over)
            self.starts[here[over], over] = fine[over]
            for row in over.tolist():
                if keep is not None and not keep[row]:
                    self.starts[self._span(row), row] = False
            self.began[over] = self.head[over]

    def cut(self) -> None:
        """End the episodes in progress, without their last transition; the next entries begin new episodes."""
        self.open[:] = BETWEEN
        self.began[:] = self.head

    def _span(self, row: int) -> np.ndarray:
        """Return the indices of the entries of the row's present episode, of all entries where none is in progress."""
        wrapped = self.head[row] <= self.began[row]
        return np.arange(self.began[row], self.head[row] + self.length * wrapped) % self.length

    def _write(self, obs: Mapping[str, np.ndarray], envs: np.ndarray) -> np.ndarray:
        """Write an entry for each of the rows `envs` (m,) and move on; return the entries' indices (m,)."""
        at = self.head[envs]
        for key, stored in self.obs.items():
            stored[at, envs] = _pack(key, obs[key])
        self.starts[at, envs] = self.first[at, envs] = False
        self.head[envs] = (at + 1) % self.length
        self.full |= bool((self.head[envs] == 0).any())
        return at

    @property
    def _used(self) -> int:
        """The number of indices that have been written in any row; all of them once a ring has wrapped round."""
        return self.length if self.full else int(self.head.max())

    def __len__(self) -> int:
        """Return the number of transitions that can be drawn."""
        return int(self.starts.sum())

    def sample(self, n: int, rng: np.random.Generator | None = None, images: Images = "both") -> Batch:
        """Draw n transitions uniformly with replacement.

        Args:
            n: number of transitions.
            rng: generator of the draws; None for the ring's own.
            images: which images the batch includes: those `before` the transition, `after` it, `both` or `none`.

        Raises:
            UserError: the ring holds no transition.
        """
        at, env = self._draw(n, self.starts, rng or self.rng)
        return self._batch(at, env, images=images)

    def sequences(self, n: int, steps: int, rng: np.random.Generator | None = None) -> Batch:
        """Draw the first `steps` transitions of n episodes, (steps, n, ...); those past an episode's end have weight 0.

        Episodes whose beginning was refused or overwritten are not drawn; a refused transition ends one.

        Raises:
            UserError: the ring holds no beginning of an episode.
        """
        at, env = self._draw(n, self.starts & self.first, rng or self.rng)
        at = (at + np.arange(steps)[:, None]) % self.length  # (steps, n)
        weight = np.logical_and.accumulate(self.starts[at, env], axis=0)
        return self._batch(at, np.broadcast_to(env, at.shape), weight)

    def _draw(self, n: int, allowed: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return index and row, (n,) each, of n entries drawn uniformly among those `allowed` (T, N)."""
        if not allowed.any():
            what = "transition" if allowed is self.starts else "beginning of an episode"
            raise UserError(f"nothing to learn from: the replay holds no {what}")
        indices = np.empty(0, np.int64)
        # draw more than n, then drop those not allowed: of transitions few are dropped, of beginnings of episodes most
        more = 2 * n if allowed is self.starts else 64 * n
        while len(indices) < n:
            drawn = rng.integers(0, self._used * self.n_envs, more)
            indices = np.concatenate([indices, drawn[allowed.reshape(-1)[drawn]]])
        return np.divmod(indices[:n], self.n_envs)

    def _batch(
        self, at: np.ndarray, env: np.ndarray, weight: np.ndarray | None = None, images: Images = "both"
    ) -> Batch:
        """Return the transitions at indices `at` of rows `env`; None for weights of 1."""
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
        """Return the observation's keys, with those of images or without."""
        return [key for key in self.obs if images or kind_of(key) is None]

    def _tensor(self, key: str, packed: np.ndarray) -> Tensor:
        kind = kind_of(key)
        return torch.from_numpy(packed if kind is None else kind.unpack(packed)).to(self.device)

    def save(self, folder: Path) -> None:
        """Write each array of the ring to its own .npy file, without the entries never written."""
        for name, array in self._arrays().items():
            np.save(folder / f"{name}.npy", array[: self._used] if array.ndim > 1 else array)

    def load(self, folder: Path) -> None:
        """Read what `save` wrote into this ring, which must have the same shapes.

        Raises:
            UserError: a file is missing or not an array, or comes from a ring of other shapes.
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
        arrays = {
            name: getattr(self, name)
            for name in ("action", "reward", "done", "starts", "first", "head", "open", "began")
        }
        return arrays | {f"obs.{key}": stored for key, stored in self.obs.items()}


def afford(entries: int, observation_space: Any, action_space: Any, key: str, what: str) -> str:
    """Return a sentence on the memory that a ring will take; refuse one that is too large.

    The system commits memory only as the ring is filled, so without this check a run would fail late.

    Args:
        entries: number of entries that will be written.
        observation_space, action_space: as for `Replay`.
        key: the option that sets the size, for the error.
        what: name of the ring, for the sentence.

    Raises:
        UserError: the ring needs more than SHARE of the free memory of this machine or of its control group.
    """
    need, free = Replay.size(entries, observation_space, action_space), available()
    size = f"{what} of {entries} entries: {in_words(need)}"
    if free is None:
        return size
    if need > SHARE * free:
        fits = int(SHARE * free / need * entries)
        expected = f"{fits} or less, or smaller images (image_size)"
        raise UserError(f"{size}, and {in_words(free)} are free", key=key, expected=expected, got=entries)
    return f"{size} of {in_words(free)} that are free"


def mixed(first: Batch, second: Batch) -> Batch:
    """Return one batch with the transitions of both, those of `first` first."""
    axis = first.reward.ndim - 1  # the axis n, the second one of sequences

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
    """Return whether NaN stands for no reading in this part of the observation."""
    kind = kind_of(key)
    return kind is not None and kind.gaps


def _finite(obs: Mapping[str, np.ndarray], n: int) -> np.ndarray:
    """Return (n,) bool, whether all values are finite; NaN in a depth image is allowed, it stands for no reading."""
    fine = np.ones(n, bool)
    for key, value in obs.items():
        if value.dtype.kind == "f" and not _gaps(key):
            fine &= np.isfinite(value.reshape(n, -1)).all(1)
    return fine
