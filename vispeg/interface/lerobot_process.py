"""The program of the LeRobot process, run by an interpreter with LeRobot: `policy FOLDER` or `robot TYPE CONFIG`.

It imports nothing of this project, because LeRobot needs other versions of packages. A message is its length (8 bytes,
little-endian) followed by an .npz archive. Errors are answered with the entry `error`, or `refused` if the message is
written for users.

- A policy receives `row` and the row's observation, and answers with `action`. `row` alone begins a new episode in that
  row. All rows share the network, and each has its own memory.
- A robot first sends the names of its numbers (`state`, `action`) and cameras (`cameras`). It receives `action` to
  execute (optional), and `look` if pictures are wanted. It answers with its observation: `time` (monotonic, s), `state`
  and `camera.NAME`.
"""

from __future__ import annotations

import copy
import importlib
import io
import json
import os
import pkgutil
import signal
import struct
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any

import numpy as np


def read(stream: IO[bytes]) -> dict[str, np.ndarray] | None:
    """Read the next message; return None if the other side has ended."""
    head = stream.read(8)
    if len(head) < 8:
        return None
    (size,) = struct.unpack("<Q", head)
    body = stream.read(size)
    if len(body) < size:
        return None
    with np.load(io.BytesIO(body), allow_pickle=False) as arrays:
        return dict(arrays)


def write(stream: IO[bytes], message: dict[str, Any]) -> None:
    """Send a message."""
    body = io.BytesIO()
    np.savez(body, **message)
    stream.write(struct.pack("<Q", len(body.getvalue())) + body.getvalue())
    stream.flush()


class Player:
    """A policy of LeRobot with its pre- and postprocessors.

    Args:
        folder: of the policy.
    """

    def __init__(self, folder: str):
        self.torch = importlib.import_module("torch")
        self.torch.set_num_threads(int(os.environ.get("OMP_NUM_THREADS") or 1))
        factory = importlib.import_module("lerobot.policies.factory")
        config = importlib.import_module("lerobot.configs.policies").PreTrainedConfig.from_pretrained(folder)
        config.device, config.pretrained_path = "cpu", folder
        self.policy = factory.get_policy_class(config.type).from_pretrained(folder, config=config)
        self.policy.eval()
        device = {"device_processor": {"device": "cpu"}}
        self.preprocess, self.postprocess = factory.make_pre_post_processors(
            config, pretrained_path=folder, preprocessor_overrides=device
        )
        self.rows: dict[int, Any] = {}

    def begin(self, row: int) -> None:
        """Clear the memory of a row: its queues of actions and of observations."""
        if row not in self.rows:
            shared = {id(t): t for t in (*self.policy.parameters(), *self.policy.buffers())}
            self.rows[row] = copy.deepcopy(self.policy, shared)
        self.rows[row].reset()

    def act(self, row: int, seen: dict[str, np.ndarray]) -> np.ndarray:
        """Return the action (d,) float32 of a row for its observation."""
        if row not in self.rows:
            self.begin(row)
        torch = self.torch
        batch: dict[str, Any] = {key: torch.from_numpy(value) for key, value in seen.items() if value.dtype.kind != "U"}
        batch |= {key: str(value) for key, value in seen.items() if value.dtype.kind == "U"}
        with torch.inference_mode():
            action = self.postprocess(self.rows[row].select_action(self.preprocess(batch)))
        return np.asarray(action.float().cpu().numpy().reshape(-1), np.float32)

    def answer(self, asked: dict[str, np.ndarray]) -> dict[str, Any]:
        """Return the answer to a message."""
        row = int(asked.pop("row"))
        if asked:
            return {"action": self.act(row, asked)}
        self.begin(row)
        return {}

    def close(self) -> None:
        """Do nothing: a policy has nothing to close."""


class Refused(Exception):
    """An error whose message is written for users."""


class Body:
    """A robot of LeRobot or of one of its plugins that are installed in the environment.

    Args:
        kind: type of the robot.
        config: fields of its configuration, as JSON.

    Raises:
        Refused: no robot of that type, or it is not calibrated.
    """

    def __init__(self, kind: str, config: str):
        robots = importlib.import_module("lerobot.robots")
        for package in (robots, importlib.import_module("lerobot.cameras")):  # importing a module registers its types
            for module in pkgutil.iter_modules(package.__path__):
                with suppress(ImportError):  # the dependencies of some types may be missing
                    importlib.import_module(f"{package.__name__}.{module.name}")
        importlib.import_module("lerobot.utils.import_utils").register_third_party_plugins()
        known = sorted(robots.RobotConfig.get_known_choices())
        if kind not in known:
            raise Refused(f"LeRobot has no robot {kind!r}; it has {', '.join(known)}")
        decode = importlib.import_module("draccus").decode
        self.robot = robots.make_robot_from_config(decode(robots.RobotConfig, {"type": kind, **json.loads(config)}))
        self.robot.connect(calibrate=False)
        if not self.robot.is_calibrated:
            self.robot.disconnect()
            raise Refused(f"is not calibrated; lerobot-calibrate --robot.type={kind} does it")
        features = self.robot.observation_features  # name -> float for a number, shape for a picture
        self.state = [key for key, kind in features.items() if kind is float]
        self.cameras = [key for key, kind in features.items() if isinstance(kind, tuple) and len(kind) == 3]
        self.action = [key for key, kind in self.robot.action_features.items() if kind is float]

    def names(self) -> dict[str, Any]:
        """Return the first message: names of the robot's numbers and cameras."""
        names = {"state": self.state, "cameras": self.cameras, "action": self.action}
        return {key: np.array(value, dtype=np.str_) for key, value in names.items()}

    def answer(self, asked: dict[str, np.ndarray]) -> dict[str, Any]:
        """Execute a message's action, if it has one, and return the robot's observation."""
        if "action" in asked:
            self.robot.send_action(dict(zip(self.action, asked["action"].tolist(), strict=True)))
        seen = self.robot.get_observation()
        out = {"time": time.monotonic(), "state": np.array([seen[key] for key in self.state], float)}
        return out | {f"camera.{key}": np.asarray(seen[key]) for key in self.cameras if "look" in asked}

    def close(self) -> None:
        """Disconnect from the robot."""
        self.robot.disconnect()


def report(error: Exception) -> dict[str, str]:
    """Return the message that reports an error."""
    return {"refused": str(error)} if isinstance(error, Refused) else {"error": f"{type(error).__name__}: {error}"}


def main() -> None:
    """Answer messages until the other side ends. LeRobot's output goes to stderr, and its input is empty."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other side handles interrupts
    incoming, outgoing = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    kinds: dict[str, Callable[..., Any]] = {"policy": Player, "robot": Body}
    try:
        served = kinds[sys.argv[1]](*sys.argv[2:])
    except Exception as error:  # LeRobot may raise anything
        write(outgoing, report(error))
        return
    write(outgoing, served.names() if isinstance(served, Body) else {})
    try:
        while (asked := read(incoming)) is not None:
            try:
                write(outgoing, served.answer(asked))
            except Exception as error:  # LeRobot may raise anything
                write(outgoing, report(error))
    except BrokenPipeError:
        pass
    finally:
        served.close()


if __name__ == "__main__":
    main()
