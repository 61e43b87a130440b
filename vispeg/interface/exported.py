"""A policy in an ONNX file, run with ONNX Runtime."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.formats.guard import MB, read_bytes
from vispeg.interface.actions import OFFSET, Actions
from vispeg.interface.interface import KEY, Interface, read
from vispeg.interface.terms import MEASURED

MEMORY = ("hidden", "cell")
ACTION = "action"  # name of the output


class Exported:
    """A policy from a file of `vispeg export`, with the methods of other policies.

    Attributes:
        interface: the meaning of its inputs and outputs.
        measured: whether `act` needs readings in SI units (MEASURED), because its actions are not offsets.
        digest: SHA-256 (hex) of the file.
    """

    def __init__(self, path: str | Path):
        require("onnxruntime", "a policy in ONNX")
        import onnxruntime as ort

        self.path, blob = Path(path), read_bytes(Path(path), 1024 * MB)
        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        try:
            self._session: Any = ort.InferenceSession(blob, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # the runtime raises various exceptions of its own
            raise UserError("is not an ONNX model", file=self.path, got=str(error).splitlines()[0][:100]) from None
        stated = self._session.get_modelmeta().custom_metadata_map
        if KEY not in stated:
            raise UserError("does not say what its numbers mean", file=self.path, expected="a file by `vispeg export`")
        self.interface: Interface = read(stated[KEY], self.path)
        self.digest = hashlib.sha256(blob).hexdigest()
        self._check()
        i = self.interface
        self.measured = i.action != OFFSET
        outputs = {x.name: x.shape for x in self._session.get_outputs()}
        if ACTION not in outputs:
            raise UserError("has no such output", file=self.path, key=ACTION, got=sorted(outputs))
        width = outputs[ACTION][-1]  # a name, not a number, if the network does not fix it
        self._actions = Actions(
            i.action,
            i,
            i.chain,
            i.tool.tip_m,
            i.arm.joints,
            width=width if isinstance(width, int) else None,
            source=self.path,
        )
        self.reset(1)

    def _check(self) -> None:
        """Raise UserError unless the network's inputs are those that its interface states."""
        i = self.interface
        expected: dict[str, tuple[int, ...]] = {"policy": (i.stack * sum(t.size for t in i.told),)}
        expected |= {key: seen.shape for key, seen in i.images.items()}
        got = {x.name: tuple(x.shape[1:]) for x in self._session.get_inputs() if x.name not in MEMORY}
        if got != expected:
            raise UserError(
                "the network's inputs are not those that the file states", file=self.path, expected=expected, got=got
            )

    @cached_property
    def _outputs(self) -> list[str]:
        return [x.name for x in self._session.get_outputs()]

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Clear the memory of `n` parallel episodes, or of those that `rows` (n,) bool selects."""
        width = self.interface.recurrent
        fresh = {name: np.zeros((1, n, width), np.float32) for name in MEMORY} if width else {}
        if rows is not None:
            for name, kept in self._memory.items():
                fresh[name][:, ~rows] = kept[:, ~rows]
        self._memory = fresh

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return actions (n, d) float32 for observations (n, ...), converted to offsets if they are of another kind."""
        parts = {key: obs[key] for key in ("policy", *self.interface.images)}
        values = self._session.run(None, {**parts, **self._memory})
        out = dict(zip(self._outputs, values, strict=True))
        self._memory = {name: out[f"{name}_next"] for name in self._memory}
        action = out[ACTION]
        if self.measured:
            self._actions.check(action.shape[-1], self.path)
            q = obs[MEASURED][:, : len(self.interface.arm.joints)]
            action = self._actions.offset(action, self._actions.seen(q)).astype(np.float32)
        return action
