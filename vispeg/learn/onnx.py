"""Export policies to ONNX, for controllers without torch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from vispeg.core.errors import UserError
from vispeg.core.extras import missing, there
from vispeg.core.files import write_bytes_atomic
from vispeg.interface.interface import KEY, Interface
from vispeg.learn.networks.actor import Actor
from vispeg.learn.policy import NetPolicy
from vispeg.render.image_kinds import RGB, kind_of

OPSET = 17


class _Positional(nn.Module):
    """The actor as a module with positional arguments: the observation's parts in order, then its memory if any."""

    def __init__(self, actor: Actor):
        super().__init__()
        self.actor = actor

    def forward(self, *parts: Tensor) -> tuple[Tensor, ...]:
        keys = self.actor.layout.keys
        obs = dict(zip(keys, parts, strict=False))
        state: Any = tuple(parts[len(keys) :]) or None
        action, after = self.actor.act(obs, state)
        return (action,) if after is None else (action, *after)


def export(policy: NetPolicy, path: str | Path, overwrite: bool = False, meaning: Interface | None = None) -> Path:
    """Write the policy, without exploration noise, as an ONNX model; return the file's path.

    Inputs are named after the observation's keys. Their shape is (n, ...) with n free; they are float32, except that
    `rgb_*` are uint8. A recurrent policy also takes `hidden` and `cell` (1, n, width), zeros at an episode's start,
    and returns `hidden_next` and `cell_next`. The output `action` is (n, action) within +-1.

    Args:
        policy: a policy from `vispeg.learn.policy.load`.
        path: the file to write.
        overwrite: whether to replace an existing file.
        meaning: the meaning of inputs and outputs, written into the file's metadata; None for none.

    Raises:
        UserError: the package `onnx` is not installed, the network cannot be exported, or the file exists.
    """
    import io
    import warnings

    actor = policy.actor.cpu().eval()
    keys, shapes = list(actor.layout.keys), actor.layout.shapes
    kinds = {key: torch.uint8 if kind_of(key) is RGB else torch.float32 for key in keys}
    parts = [torch.zeros(2, *shapes[key], dtype=kinds[key]) for key in keys]
    outputs, axes = ["action"], {key: {0: "n"} for key in (*keys, "action")}
    state = actor.initial(2)
    if state is not None:
        parts, keys = [*parts, *state], [*keys, "hidden", "cell"]
        outputs += ["hidden_next", "cell_next"]
        axes |= {name: {1: "n"} for name in ("hidden", "cell", "hidden_next", "cell_next")}
    file = io.BytesIO()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the exporter's warnings about tracing
            torch.onnx.export(
                _Positional(actor),
                tuple(parts),
                file,  # type: ignore[arg-type]  # torch declares a path alone, and takes a stream
                input_names=keys,
                output_names=outputs,
                dynamic_axes=axes,
                opset_version=OPSET,
                dynamo=False,
            )
    except (ImportError, torch.onnx.errors.OnnxExporterError) as error:
        if not there("onnx"):
            raise missing("onnx", "export to ONNX") from error
        raise UserError("the network cannot be exported", got=str(error).splitlines()[0]) from error
    return write_bytes_atomic(path, _stating(file.getvalue(), meaning), overwrite=overwrite)


def _stating(model: bytes, meaning: Interface | None) -> bytes:
    """Return the model's bytes with its meaning added to its metadata."""
    if meaning is None:
        return model
    import onnx

    out = onnx.ModelProto.FromString(model)
    out.producer_name, out.doc_string = "vispeg", meaning.title
    out.metadata_props.add(key=KEY, value=meaning.text())
    return out.SerializeToString()
