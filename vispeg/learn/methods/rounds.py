"""Store the finished rounds of a distillation, so that a killed one resumes with the same curve. No pickle."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NotRequired, TypedDict, cast

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder, write_text_atomic
from vispeg.formats.guard import as_written
from vispeg.formats.json_data import read_json
from vispeg.learn.experience.replay import Replay
from vispeg.learn.networks.actor import Actor
from vispeg.learn.networks.tensors import adam, fill, wake, write

ROUNDS = "rounds"  # folder inside the run's folder; deleted once the run is finished
STATE = "state.json"  # file in ROUNDS that lists the finished rounds


class RoundResult(TypedDict):
    """The result of a round.

    Keys:
        best: success rate, and mean peak force in N with a minus sign, of the best student so far.
        command: the command line that began the run.
        reached: number of latest rounds in a row that reached the target.
        stop: whether this was the last round.
    """

    best: NotRequired[list[float]]
    command: NotRequired[str]
    reached: NotRequired[int]
    stop: NotRequired[bool]


class RoundState(RoundResult):
    """A round's result, with the number of finished rounds and the file of the last one's weights."""

    rounds: int
    student: str


class Rounds:
    """The finished rounds in a folder: each one's transitions and student, with the state of the optimizer.

    Args:
        folder: `rounds/` in a run's folder; the first `keep` makes it.
        like: a ring with the observation and action spaces of the stored ones.
    """

    def __init__(self, folder: Path, like: Replay):
        self.folder, self.like = folder, like

    @property
    def state(self) -> RoundState | None:
        """The result passed to `keep` after the last finished round, with its number and file; None before the first.

        Raises:
            UserError: the file is damaged.
        """
        path = self.folder / STATE
        if not path.exists():
            return None
        with as_written(path, "vispeg train"):
            state = read_json(path, finite=False)
            return cast("RoundState", {**state, "rounds": int(state["rounds"]), "student": str(state["student"])})

    @property
    def done(self) -> int:
        """The number of finished rounds."""
        state = self.state
        return 0 if state is None else state["rounds"]

    def keep(self, ring: Replay | None, actor: Actor, optimizer: torch.optim.Optimizer, result: RoundResult) -> None:
        """Store one more round; it counts as finished once its `state`, written last, is there.

        Args:
            ring: its transitions; None where nothing was played.
            actor: the student after the round.
            optimizer: Adam after the round.
            result: JSON data that `state` returns.
        """
        done = self.done
        self.folder.mkdir(exist_ok=True)
        if ring is not None:
            keep_ring(ring, self.folder / f"ring-{done}")
        name = f"student-{done}.safetensors"
        write(self.folder / name, {"rng": torch.get_rng_state(), **_tensors(actor, optimizer)})
        text = json.dumps({**result, "rounds": done + 1, "student": name}, indent=1) + "\n"
        write_text_atomic(self.folder / STATE, text, overwrite=True)

    def rings(self) -> list[Replay]:
        """Return the transitions of each finished round. Raises UserError where a round's are missing."""
        return [kept_ring(self.folder / f"ring-{number}", self.like) for number in range(self.done)]

    def restore(self, actor: Actor, optimizer: torch.optim.Optimizer) -> None:
        """Restore student, optimizer and torch's random state as after the last round, if there was one.

        Raises:
            UserError: a file is missing or damaged, or the student has other shapes.
        """
        state = self.state
        if state is None:
            return
        path = self.folder / state["student"]
        try:
            stored = load_file(path)
        except (OSError, SafetensorError) as error:
            raise UserError("not the student of a distillation", file=path) from error
        wake(optimizer)
        random = stored.pop("rng", torch.get_rng_state())
        fill(_tensors(actor, optimizer), stored, path)
        torch.set_rng_state(random)


def keep_ring(ring: Replay, folder: Path) -> None:
    """Store a ring's transitions and its size."""
    with new_folder(folder, overwrite=True, holds=None) as place:
        ring.save(place)
        (place / "ring.json").write_text(json.dumps({"length": ring.length, "n_envs": ring.n_envs}) + "\n")


def kept_ring(folder: Path, like: Replay) -> Replay:
    """Return the ring that `keep_ring` stored; `like` has its spaces. Raises UserError if the two do not fit."""
    with as_written(folder / "ring.json", "vispeg train"):
        size = read_json(folder / "ring.json")
        length, rows = int(size["length"]), int(size["n_envs"])
    ring = Replay(length * rows, like.observation_space, like.action_space, like.device, rows)
    ring.load(folder)
    return ring


def _tensors(actor: Actor, optimizer: torch.optim.Optimizer) -> dict[str, torch.Tensor]:
    return {f"actor.{k}": v for k, v in actor.state_dict().items()} | adam(optimizer, "actor")
