"""The driver of a simulated robot in a separate process: `--robot sim:WORLD`, or `sim:WORLD?latency=0.01`."""

from __future__ import annotations

import json
import secrets
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any
from urllib.parse import parse_qsl

import numpy as np

from vispeg.core.errors import UserError
from vispeg.interface.builder import Picture
from vispeg.interface.interface import Interface
from vispeg.render.image_kinds import camera_of
from vispeg.trials.driver import Connected, Reading
from vispeg.trials.wire import receive, send

ANSWER = 2.0  # s, timeout of an answer; a software-rendered picture on a busy machine takes some tenths of a second


class SocketRobot:
    """Drive a simulated robot through a loopback socket.

    Args:
        text: WORLD, or WORLD?latency=SECONDS, the delay of each command and of each reading but its pictures.
    """

    def __init__(self, text: str):
        self.world, _, rest = text.partition("?")
        options = dict(parse_qsl(rest, keep_blank_values=True))
        value = options.pop("latency", "0")
        try:
            self.latency = float(value)
        except ValueError:
            self.latency = -1.0
        if options or not 0 <= self.latency <= 0.5 or (rest and "=" not in rest):
            expected = "sim:WORLD, or sim:WORLD?latency=SECONDS up to 0.5"
            raise UserError("not a simulated robot", key="--robot", expected=expected, got=f"sim:{text}")
        from vispeg.task.world_file import load_world

        load_world(self.world)
        self._link: socket.socket | None = None
        self._process: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()  # the watchdog may call `stop` while the loop reads

    def connect(self, interface: Interface, seed: int) -> Connected:
        """See Driver."""
        if self._link is None:
            self._open(interface)
        answer, _ = self._ask({"call": "connect", "seed": seed}, wait=60.0)
        return Connected(start=answer["start"], world=answer["world"])

    def _open(self, interface: Interface) -> None:
        settings: dict[str, Any] = {"policy_period": interface.policy_period_s, "dof": list(interface.dof)}
        if interface.images:
            eyes = [seen.eye for seen in interface.images.values()]
            settings["cameras"] = list(dict.fromkeys(eye.name for eye in eyes))
            settings["image_size"] = min(min(eye.width, eye.height) for eye in eyes)
        from vispeg.learn.modalities import modality

        mode, token = modality(interface.modality).obs_mode, secrets.token_hex(16)
        robot = {"world": self.world, "obs_mode": mode, "settings": settings, "latency": self.latency, "token": token}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "vispeg.trials.simulated"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps(robot) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        answer = json.loads(line) if line else {"error": "the simulated robot did not start"}
        if "error" in answer:
            self.close()
            raise UserError(answer["error"])
        self._link = socket.create_connection(("127.0.0.1", answer["port"]), timeout=ANSWER)
        self._link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        send(self._link, {"token": token})

    def read(self, cameras: Sequence[str] = ()) -> Reading:
        """See Driver."""
        answer, values = self._ask({"call": "read", "cameras": list(cameras)})
        pictures: dict[str, dict[str, np.ndarray]] = {}
        for key, image in values.items():
            if key not in ("q", "dq", "wrench"):
                pictures.setdefault(camera_of(key), {})["depth" if image.ndim == 2 else "rgb"] = image
        by_camera = {name: Picture(kinds.get("rgb"), kinds.get("depth")) for name, kinds in pictures.items()}
        return Reading(answer["time"], values["q"], values["dq"], values["wrench"], by_camera)

    def ended(self) -> bool:
        """See Driver."""
        return bool(self._ask({"call": "ended"})[0]["ended"])

    def command(self, pose: np.ndarray) -> None:
        """See Driver."""
        with self._lock:
            if self._link is None:
                raise OSError("not connected")
            send(self._link, {"call": "command"}, {"pose": np.asarray(pose, float)})

    def stop(self) -> Mapping[str, Any] | None:
        """See Driver."""
        return None if self._link is None else self._ask({"call": "stop"})[0]

    def close(self) -> None:
        """End the process."""
        if self._link is not None:
            self._link.close()
            self._link = None
        if self._process is not None:
            for end in (self._process.stdin, self._process.stdout):
                if end is not None:
                    end.close()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(2.0)
            self._process.kill()
            self._process.wait()
            self._process = None

    def _ask(self, message: Mapping[str, Any], wait: float = ANSWER) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Send a message and return its answer, within `wait` s; else end the process and raise OSError."""
        with self._lock:
            if self._link is None:
                raise OSError("not connected")
            self._link.settimeout(wait)
            try:
                send(self._link, message)
                return receive(self._link)
            except (OSError, EOFError) as error:
                self.close()  # an answer that comes later must not be taken for that of the next message
                raise OSError(str(error)) from error
