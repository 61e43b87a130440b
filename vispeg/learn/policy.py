"""Policies, and their folders with `policy.safetensors` and `policy.json`. No pickle."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor

from vispeg.core.assets import assets
from vispeg.core.errors import UserError
from vispeg.core.files import write_bytes_atomic, write_text_atomic
from vispeg.formats.format import copy, enrol
from vispeg.formats.guard import read_bytes
from vispeg.learn.layout import OFFSET_M, VECTOR, Layout
from vispeg.learn.meta import observed
from vispeg.learn.modalities import Modality
from vispeg.learn.modalities import modality as modality_of
from vispeg.learn.networks.actor import Actor, State
from vispeg.learn.record import NETWORK, WEIGHTS, check_weights, read_record
from vispeg.learn.shipped import META, policy_folder

LARGEST = 1_000_000_000  # largest file of weights, bytes


class Policy(Protocol):
    """The interface of what can be played and evaluated.

    Attributes:
        modality: name of what it sees: `state`, `privileged`, `proprio`, `depth`, `rgb`, `rgbd`, or a user's own.
        meta: record of its origin; see `save`.
        layout: names and shapes of its observation and action.
        recurrent: width of its LSTM; 0 for none: then a stack of observations is its only memory.
        estimate: (n, 3) m, the tip in the goal's frame as estimated in the last `act`; None where the policy has no
            such output.
    """

    modality: str
    meta: Mapping[str, Any]
    layout: Layout
    recurrent: int
    estimate: np.ndarray | None

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Clear the memory of all n rows, or only of those where `rows` (n,) is True."""
        ...

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return actions (n, action) float32 within +-1 for observation arrays (n, ...)."""
        ...


class NetPolicy:
    """Act with a trained actor, without exploration noise.

    Attributes:
        actor: the network.
    """

    def __init__(self, actor: Actor, modality: str, meta: Mapping[str, Any] | None = None):
        self.actor, self.modality = actor, modality
        self.meta: Mapping[str, Any] = dict(meta or {})
        self.layout, self.recurrent = actor.layout, actor.recurrent
        self.estimate: np.ndarray | None = None
        self._state: State | None = None

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """See Policy."""
        if self._state is None or rows is None:
            self._state = self.actor.initial(n)
        else:
            going = torch.from_numpy(~rows).to(self._state[0].device)[None, :, None]
            self._state = (self._state[0] * going, self._state[1] * going)

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """See Policy. On one machine, an episode's actions are the same to the last bit, whatever the other rows do.

        The rounding of matrix products varies with the processor, and on one processor with the number of rows, a
        row's position, memory alignment and threads. Contact amplifies a difference in the last bit into a different
        episode. So the network computes each row alone, in freshly allocated memory and in one thread.

        Raises:
            UserError: the observation has another layout.
        """
        self.actor.layout.check(obs)
        parts = {
            key: torch.as_tensor(np.ascontiguousarray(obs[key]), device=self.actor.device)
            for key in self.actor.layout.keys
        }
        with torch.inference_mode(), one_thread():
            rows = [self._row(parts, slice(row, row + 1)) for row in range(len(obs[VECTOR]))]
        actions, offsets, hidden, cell = zip(*rows, strict=True)
        if self.recurrent:
            self._state = torch.cat(hidden, dim=1), torch.cat(cell, dim=1)
        if self.actor.offset is not None:
            self.estimate = OFFSET_M * torch.cat(offsets).cpu().numpy()
        return torch.cat(actions).cpu().numpy().astype(np.float32)

    def _row(self, parts: Mapping[str, Tensor], row: slice) -> tuple[Any, Any, Any, Any]:
        """Return action, offset, hidden and cell state of one row, computed on copies so that alignment is fixed."""
        state = None
        if self._state is not None:
            hidden, cell = self._state
            state = hidden[:, row].clone(), cell[:, row].clone()
        features = self.actor.features({key: x[row].clone() for key, x in parts.items()})
        latent, after = self.actor.latent(features, state)
        offset = None if self.actor.offset is None else self.actor.offset(latent)
        hidden, cell = after or (None, None)
        return torch.tanh(self.actor.mean(latent)), offset, hidden, cell


@contextmanager
def one_thread() -> Iterator[None]:
    """Make torch compute in one thread while the body runs."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def save(folder: str | Path, actor: Actor, modality: str, meta: Mapping[str, Any]) -> None:
    """Write policy.safetensors and policy.json; replace those of an earlier `save`.

    Args:
        folder: the policy's folder.
        actor: the network.
        modality: name of what it sees.
        meta: its origin, as JSON data; by convention `command`, `seed`, `world`, `world_hash`, `task`, `steps`,
            `success`, `versions`.
    """
    weights = save_tensors({name: value.detach().cpu().contiguous() for name, value in actor.state_dict().items()})
    record = {
        "format": NETWORK.name,
        "modality": modality,
        "layout": actor.layout.to_json(),
        "net": {"hidden": list(actor.hidden), "recurrent": actor.recurrent},
        "weights": f"sha256:{hashlib.sha256(weights).hexdigest()}",
        "meta": dict(meta),
    }
    text = json.dumps(record, indent=2, allow_nan=False) + "\n"
    # removed first: a process killed between the two writes then leaves no policy rather than a wrong one
    (Path(folder) / META).unlink(missing_ok=True)
    write_bytes_atomic(Path(folder) / WEIGHTS, weights, overwrite=True)
    write_text_atomic(Path(folder) / META, text, overwrite=True)


@enrol("policy's weights", lambda folder: copy(assets() / "policies" / "state-3mm", folder))
def load(folder: str | Path, device: str = "cpu") -> NetPolicy:
    """Load the policy in a folder, or the shipped policy of that name. No code in the files is executed.

    Args:
        folder: the policy's folder, or the name of a shipped policy.
        device: torch device of the network.

    Raises:
        UserError: no such folder, a file is missing or damaged, two policies in one folder, weights that are not
            finite or do not match policy.json, or a modality that this installation does not have.
    """
    path = policy_folder(folder)
    record = read_record(path)
    if "layout" not in record or "net" not in record:
        raise UserError("holds two policies", file=path, expected=f"one network ({NETWORK.name})")
    modality = modality_of(record["modality"])
    check_weights(path, record)
    layout, net = Layout.from_json(record["layout"]), record["net"]
    if modality.knows and not layout.reads:  # older records do not state `reads`
        layout = replace(layout, reads=observed(record["meta"]).for_teachers)
    actor = _actor(layout, modality, net, path)
    try:
        actor.load_state_dict(load_tensors(read_bytes(path / WEIGHTS, LARGEST)))
    except (SafetensorError, RuntimeError, ValueError, TypeError, KeyError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise UserError(f"not the weights of the policy beside it: {reason}", file=path / WEIGHTS) from error
    for name, value in actor.state_dict().items():
        if not torch.isfinite(value).all():
            raise UserError("holds weights that are not finite", file=path / WEIGHTS, key=name)
    return NetPolicy(actor.to(device).eval().requires_grad_(False), modality.name, record["meta"])


def _actor(layout: Layout, modality: Modality, net: Mapping[str, Any], path: Path) -> Actor:
    """Return the network that a record describes, with untrained weights."""
    try:
        return Actor(layout, modality, tuple(net["hidden"]), net["recurrent"])
    except (RuntimeError, ValueError, TypeError, MemoryError) as error:  # such as images too small for the encoder
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise UserError(f"no network can be made of this ({reason})", file=path / META, key="layout") from None
