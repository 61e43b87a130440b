"""The whole state of a training run on disk, so that a killed run goes on with the same curve. No pickle."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.learn.sac import AsymmetricSAC


def save_state(folder: Path, model: AsymmetricSAC, counters: dict[str, Any]) -> None:
    """Writes weights, optimizers, temperature, replay, random states and counters into an existing folder.

    What is not written is the environments' state: call this just before `AsymmetricSAC.restart`, after which nothing
    depends on it.
    """
    save_file(
        {name: value.detach().cpu().contiguous() for name, value in _tensors(model).items()},
        folder / "state.safetensors",
    )
    ring = folder / "replay"
    ring.mkdir(exist_ok=True)
    model.replay.save(ring)
    own = {
        "num_timesteps": model.num_timesteps,
        "n_updates": model._n_updates,
        "owed": model._owed,
        "measured": model.measured,
        "replay_rng": model.replay.rng.bit_generator.state,
        "refused": model.replay.refused,
        "counters": counters,
    }
    (folder / "state.json").write_text(json.dumps(own, indent=1) + "\n", encoding="utf-8")


def load_state(folder: Path, model: AsymmetricSAC) -> dict[str, Any]:
    """Puts a model made by the same settings into the state that `save_state` wrote; returns its counters.

    Raises:
        UserError: a file is missing or damaged, or from a model of other shapes.
    """
    try:
        own = json.loads((folder / "state.json").read_text(encoding="utf-8"))
        found = load_file(folder / "state.safetensors")
    except (OSError, ValueError, SafetensorError) as error:
        raise UserError("not a checkpoint that training can go on from", file=folder) from error
    _touch_optimizers(model)
    wanted = _tensors(model)
    idle = {
        k: torch.zeros_like(v) for k, v in wanted.items() if k.startswith("adam.")
    }  # moments of what never moved yet
    found = {**idle, **found}
    if {k: v.shape for k, v in wanted.items()} != {k: v.shape for k, v in found.items()}:
        raise UserError("the checkpoint is of a model with other shapes or settings", file=folder / "state.safetensors")
    with torch.no_grad():
        for name, value in wanted.items():
            if not name.startswith("rng."):
                value.copy_(found[name])
    torch.set_rng_state(found["rng.torch"])
    if "rng.cuda" in found and torch.cuda.is_available():
        torch.cuda.set_rng_state(found["rng.cuda"])
    model.replay.load(folder / "replay")
    model.replay.rng.bit_generator.state = own["replay_rng"]
    model.replay.refused = int(own["refused"])
    model.num_timesteps, model._n_updates = int(own["num_timesteps"]), int(own["n_updates"])
    model._owed, model.measured = float(own["owed"]), bool(own["measured"])
    return own["counters"]


def _tensors(model: AsymmetricSAC) -> dict[str, Tensor]:
    """Every tensor of the run, by name; not copies."""
    out: dict[str, Tensor] = {"rng.torch": torch.get_rng_state()}
    if model.device.type == "cuda":
        out["rng.cuda"] = torch.cuda.get_rng_state()
    for name in ("actor", "critic", "critic_target"):
        out |= {f"{name}.{key}": value for key, value in getattr(model, name).state_dict().items()}
    if model.log_ent_coef is not None:
        out["log_temperature"] = model.log_ent_coef.detach()
    for name, optimizer in _optimizers(model).items():
        for number, parameter in enumerate(p for group in optimizer.param_groups for p in group["params"]):
            for key, value in optimizer.state.get(parameter, {}).items():
                out[f"adam.{name}.{number}.{key}"] = value
    return out


def _optimizers(model: AsymmetricSAC) -> dict[str, torch.optim.Optimizer]:
    found = {"actor": model.actor.optimizer, "critic": model.critic.optimizer, "temperature": model.ent_coef_optimizer}
    return {name: optimizer for name, optimizer in found.items() if optimizer is not None}


def _touch_optimizers(model: AsymmetricSAC) -> None:
    """Makes Adam's moments exist, without moving a weight, so that they can be filled."""
    for optimizer in _optimizers(model).values():
        for group in optimizer.param_groups:
            for parameter in group["params"]:
                optimizer.state[parameter] = {
                    "step": torch.zeros((), dtype=torch.float32, device=parameter.device if group["fused"] else "cpu"),
                    "exp_avg": torch.zeros_like(parameter),
                    "exp_avg_sq": torch.zeros_like(parameter),
                }


def restart_seed(seed: int, step: int) -> int:
    """Seed of the episodes after a checkpoint: below 2^30, so that rows counted from it meet no held-out seed."""
    return int(stream(seed, "restart", step).integers(2**30))
