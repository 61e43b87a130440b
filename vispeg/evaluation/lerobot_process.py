"""The side of LeRobot: run by an interpreter that has it, with a policy's folder as argument, to play that policy.

It imports nothing of this project, for LeRobot asks for other versions of packages. A message is its length (8 bytes,
little-endian) and an .npz: in comes `row` and what the row observes, or `row` alone where an episode begins there; out
goes `action`, or `error`. Each row has a memory of its own, and all share the network.
"""

from __future__ import annotations

import copy
import importlib
import io
import os
import struct
import sys
from typing import Any, BinaryIO

import numpy as np


def read(stream: BinaryIO) -> dict[str, np.ndarray] | None:
    """Return the next message, or None where the other side is gone."""
    head = stream.read(8)
    if len(head) < 8:
        return None
    (size,) = struct.unpack("<Q", head)
    body = stream.read(size)
    if len(body) < size:
        return None
    with np.load(io.BytesIO(body), allow_pickle=False) as arrays:
        return dict(arrays)


def write(stream: BinaryIO, message: dict[str, Any]) -> None:
    """Send a message."""
    body = io.BytesIO()
    np.savez(body, **message)
    stream.write(struct.pack("<Q", len(body.getvalue())) + body.getvalue())
    stream.flush()


class Player:
    """A policy with what LeRobot puts before and behind its network."""

    def __init__(self, folder: str):
        self.torch = importlib.import_module("torch")
        self.torch.set_num_threads(int(os.environ.get("OMP_NUM_THREADS") or 1))
        factory = importlib.import_module("lerobot.policies.factory")
        config = importlib.import_module("lerobot.configs.policies").PreTrainedConfig.from_pretrained(folder)
        config.device, config.pretrained_path = "cpu", folder
        self.policy = factory.get_policy_class(config.type).from_pretrained(folder, config=config)
        self.policy.eval()
        device = {"device_processor": {"device": "cpu"}}
        self.before, self.behind = factory.make_pre_post_processors(
            config, pretrained_path=folder, preprocessor_overrides=device
        )
        self.rows: dict[int, Any] = {}

    def begin(self, row: int) -> None:
        """Clear the memory of a row: queues of actions and of observations."""
        if row not in self.rows:
            shared = {id(t): t for t in (*self.policy.parameters(), *self.policy.buffers())}
            self.rows[row] = copy.deepcopy(self.policy, shared)
        self.rows[row].reset()

    def act(self, row: int, seen: dict[str, np.ndarray]) -> np.ndarray:
        """Return the action of a row."""
        if row not in self.rows:
            self.begin(row)
        torch = self.torch
        batch: dict[str, Any] = {key: torch.from_numpy(value) for key, value in seen.items() if value.dtype.kind != "U"}
        batch |= {key: str(value) for key, value in seen.items() if value.dtype.kind == "U"}
        with torch.inference_mode():
            action = self.behind(self.rows[row].select_action(self.before(batch)))
        return np.asarray(action.float().cpu().numpy().reshape(-1), np.float32)


def main() -> None:
    """Answer until the other side is gone; what LeRobot prints goes to stderr."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        player = Player(sys.argv[1])
    except Exception as error:  # whatever LeRobot raises
        write(out, {"error": f"{type(error).__name__}: {error}"})
        return
    write(out, {})
    while (asked := read(sys.stdin.buffer)) is not None:
        row = int(asked.pop("row"))
        try:
            write(out, {"action": player.act(row, asked)} if asked else player.begin(row) or {})
        except Exception as error:  # whatever LeRobot raises
            write(out, {"error": f"{type(error).__name__}: {error}"})


if __name__ == "__main__":
    main()
