"""Save and load the whole state of a training run, so that a killed run resumes with the same curve. No pickle."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import NotRequired, TypedDict

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.formats.guard import as_written
from vispeg.formats.json_data import read_json
from vispeg.learn.methods.sac import AsymmetricSAC
from vispeg.learn.networks.tensors import adam, fill, wake, write


class Counters(TypedDict):
    """The state of a run besides its networks.

    Keys:
        command: the command line that began the run; older runs lack it.
        stage: index of the curriculum's present stage.
        best: success rate, and mean peak force in N with a minus sign, of the best policy so far.
        reached: number of latest evaluations in a row that reached the target.
        recent: success and category of the last training episodes.
        ranges: what `vispeg.learn.methods.ranges.Opening.state` returns; None where ranges are fully open throughout.
    """

    command: NotRequired[str]
    stage: int
    best: list[float]
    reached: int
    recent: list[tuple[bool, str]]
    ranges: Mapping[str, object] | None


def save_state(folder: Path, model: AsymmetricSAC, counters: Counters) -> None:
    """Write weights, optimizers, temperature, replay, random states and counters into an existing folder.

    The environments' state is not written. So call this just before `AsymmetricSAC.restart`, which resets them.
    """
    for optimizer in _optimizers(model).values():
        if not optimizer.state:  # no update yet: write the zero moments that `load_state` expects
            wake(optimizer)
    write(folder / "state.safetensors", _tensors(model) | _random(model))
    ring = folder / "replay"
    ring.mkdir(exist_ok=True)
    model.replay.save(ring)
    state = {
        "num_timesteps": model.num_timesteps,
        "n_updates": model._n_updates,
        "owed": model._owed,
        "measured": model.measured,
        "replay_rng": model.replay.rng.bit_generator.state,
        "refused": model.replay.refused,
        "counters": counters,
    }
    (folder / "state.json").write_text(json.dumps(state, indent=1) + "\n", encoding="utf-8")


def load_state(folder: Path, model: AsymmetricSAC) -> Counters:
    """Load the state that `save_state` wrote into a model made with the same settings; return its counters.

    Raises:
        UserError: a file is missing or damaged, or comes from a model with other shapes.
    """
    try:
        state = read_json(folder / "state.json", finite=False)
        stored = load_file(folder / "state.safetensors")
    except (UserError, OSError, ValueError, SafetensorError) as error:
        raise UserError(f"not a checkpoint that training can resume from ({error})", file=folder) from error
    for optimizer in _optimizers(model).values():
        wake(optimizer)
    random = {name: stored.pop(name) for name in [*stored] if name.startswith("rng.")}
    fill(_tensors(model), stored, folder / "state.safetensors")
    if "rng.torch" in random:
        torch.set_rng_state(random["rng.torch"])
    if "rng.cuda" in random and torch.cuda.is_available():
        torch.cuda.set_rng_state(random["rng.cuda"])
    model.replay.load(folder / "replay")
    with as_written(folder / "state.json", "vispeg train"):
        model.replay.rng.bit_generator.state = state["replay_rng"]
        model.replay.refused = int(state["refused"])
        model.num_timesteps, model._n_updates = int(state["num_timesteps"]), int(state["n_updates"])
        model._owed, model.measured = float(state["owed"]), bool(state["measured"])
        return state["counters"]


def _random(model: AsymmetricSAC) -> dict[str, Tensor]:
    states = {"rng.torch": torch.get_rng_state()}
    return states | ({"rng.cuda": torch.cuda.get_rng_state()} if model.device.type == "cuda" else {})


def _tensors(model: AsymmetricSAC) -> dict[str, Tensor]:
    """Return every tensor that training changes, by name; not copies."""
    out: dict[str, Tensor] = {}
    for name in ("actor", "critic", "critic_target"):
        out |= {f"{name}.{key}": value for key, value in getattr(model, name).state_dict().items()}
    if model.log_ent_coef is not None:
        out["log_temperature"] = model.log_ent_coef.detach()
    for name, optimizer in _optimizers(model).items():
        out |= adam(optimizer, name)
    return out


def _optimizers(model: AsymmetricSAC) -> dict[str, torch.optim.Optimizer]:
    optimizers = {
        "actor": model.actor.optimizer,
        "critic": model.critic.optimizer,
        "temperature": model.ent_coef_optimizer,
    }
    return {name: optimizer for name, optimizer in optimizers.items() if optimizer is not None}


def restart_seed(seed: int, step: int) -> int:
    """Return the seed of the episodes after a checkpoint.

    It is below 2^30: seeds counted up from it for the rows never reach the held-out seeds, which start at 2^31.
    """
    return int(stream(seed, "restart", step).integers(2**30))
