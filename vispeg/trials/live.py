"""Publish a run in progress to other processes: a status file in its folder of trials, and a file to stop it.

The loop hands over its state without waiting; a thread writes the newest state. `TRIALS/.live` is removed at the end.
"""

from __future__ import annotations

import base64
import math
import os
import re
import secrets
import shutil
import socket
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vispeg.core.errors import UserError
from vispeg.formats.json_data import read_json
from vispeg.formats.typed import typed
from vispeg.interface.builder import Picture
from vispeg.render.image_kinds import grey_depth
from vispeg.trials.loop import Step

FOLDER, STATE, STOP = ".live", "state.json", "stop-"
WIDEST = 320  # px: wider pictures are subsampled
QUALITY = 80  # JPEG quality
LOOKS = 0.02  # s between checks for a request to stop
RECENT = 5.0  # s; a run on another machine counts as alive this long after its last write
ID = r"^[0-9a-f]{16}-[0-9]+$"

Numbers = list[Annotated[float, Field(allow_inf_nan=False)]]


class State(BaseModel):
    """State of a run.

    Attributes:
        id: id of the episode.
        pid, host: process id and host of the run.
        at: time of writing, s since 1970.
        policy, robot: names of the policy and the robot.
        trial: folder of the episode.
        episode, episodes: number of the episode, and how many the run has.
        phase: `rest` before the policy acts, `acts`, or `over`.
        outcomes: outcomes of the run's finished episodes.
        step, of, late_s, missed, tip_m, force_n, pose, target, wrench, shares: as in `vispeg.trials.loop.Step`.
        pictures: by camera, JPEG in base64.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    id: Annotated[str, Field(pattern=ID)]
    pid: int
    host: str
    at: float
    policy: str
    robot: str
    trial: str
    episode: int
    episodes: int
    phase: Literal["rest", "acts", "over"] = "rest"
    outcomes: list[str] = []
    step: int = 0
    of: int = 0
    late_s: float = 0.0
    missed: int = 0
    tip_m: Numbers | None = None
    force_n: float | None = None
    pose: Numbers | None = None
    target: Numbers | None = None
    wrench: Numbers | None = None
    shares: dict[str, float] = {}
    pictures: dict[str, Annotated[str, Field(pattern=r"^[A-Za-z0-9+/=]*$")]] = {}

    @property
    def running(self) -> bool:
        """Whether the process of the run is alive."""
        if self.host != socket.gethostname():
            return time.time() - self.at < RECENT
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:
            return True
        return True


class Live:
    """Publish a run to other processes; use it as a context manager.

    Args:
        place: folder of the trials.
        policy, robot: names of the policy and the robot.
        episodes: number of episodes of the run.
    """

    def __init__(self, place: Path, policy: str, robot: str, episodes: int):
        self._folder, self._run = place / FOLDER, secrets.token_hex(8)
        self._common: dict[str, Any] = {"pid": os.getpid(), "host": socket.gethostname(), "outcomes": []}
        self._common |= {"policy": policy, "robot": robot, "episodes": episodes}
        self._stop, self._stop_asked, self._newest = self._folder / STOP, False, None
        self._changed, self._over = threading.Condition(), False
        self._thread = threading.Thread(target=self._write, daemon=True)

    def __enter__(self) -> Live:
        with suppress(OSError):
            shutil.rmtree(self._folder, ignore_errors=True)  # left by a run that was killed
            self._folder.mkdir()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._over = True
            self._changed.notify()
        self._thread.join()
        shutil.rmtree(self._folder, ignore_errors=True)

    def begin(self, trial: str, episode: int) -> None:
        """Publish that an episode begins, and the name of its trial."""
        self._common |= {"id": f"{self._run}-{episode}", "trial": trial, "episode": episode}
        with self._changed:
            self._stop, self._stop_asked = self._folder / f"{STOP}{self._common['id']}", False
        self._publish({**self._common, "phase": "rest"}, {})

    def step(self, step: Step) -> None:
        """Publish a step."""
        numbers = {"step": step.number, "of": step.of, "late_s": step.late, "missed": step.missed, "tip_m": step.tip}
        numbers |= {"force_n": step.force, "pose": step.pose, "target": step.target, "wrench": step.wrench}
        self._publish({**self._common, **numbers, "phase": "acts", "shares": step.shares}, step.pictures)

    def end(self, outcome: str) -> None:
        """Publish how an episode ended."""
        self._common["outcomes"] = [*self._common["outcomes"], outcome]
        self._publish({**self._common, "phase": "over"}, {})

    def stopped(self) -> bool:
        """Return whether another process has requested the end of this episode."""
        return self._stop_asked

    def _publish(self, state: Mapping[str, Any], pictures: Mapping[str, Picture]) -> None:
        with self._changed:
            self._newest = state, pictures
            self._changed.notify()

    def _write(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._over or self._newest is not None, LOOKS)
                self._stop_asked = self._stop_asked or os.path.exists(self._stop)
                if self._newest is None:
                    if self._over:
                        return
                    continue
                (state, pictures), self._newest = self._newest, None
            with suppress(Exception):  # a full disk or an odd picture must not stop an arm
                images = {name: encoded(picture) for name, picture in pictures.items()}
                plain = {key: v.tolist() if isinstance(v, np.ndarray) else v for key, v in state.items()}
                part = self._folder / f".{STATE}"
                part.write_text(State(**plain, at=time.time(), pictures=images).model_dump_json(), encoding="utf-8")
                os.replace(part, self._folder / STATE)


def encoded(picture: Picture) -> str:
    """Encode a picture as JPEG in base64: its colour, else its depth in grey."""
    import cv2

    whole = picture.rgb if picture.rgb is not None else grey_depth(np.asarray(picture.depth))
    every = math.ceil(whole.shape[1] / WIDEST)  # keep every n-th pixel
    image = np.ascontiguousarray(whole[::every, ::every])
    data = cv2.imencode(".jpg", image[..., ::-1] if image.ndim == 3 else image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
    return base64.b64encode(data.tobytes()).decode()


def is_live(place: Path) -> bool:
    """Return whether a folder of trials has a run's status file."""
    return (place / FOLDER / STATE).is_file()


def read_live(place: Path) -> State | None:
    """Read the state of the run in a folder of trials; None without a run. Raises UserError: an invalid file."""
    file = place / FOLDER / STATE
    if not is_live(place):
        return None
    try:
        state = typed(State, read_json(file), file)
    except UserError:
        if not file.is_file():  # the run has just ended
            return None
        raise
    return state if state.running else None


def ask_stop(place: Path, episode: str) -> None:
    """Request the run in a folder of trials to end the episode with this id, as its stop key does.

    Raises:
        UserError: no run is in progress, or not in this episode.
    """
    state = read_live(place)
    if state is None:
        raise UserError("no run is in progress", file=place)
    if not re.match(ID, episode) or episode != state.id or state.phase == "over":
        raise UserError("no such episode is in progress", file=place, expected=state.id, got=episode)
    (place / FOLDER / f"{STOP}{episode}").touch()
