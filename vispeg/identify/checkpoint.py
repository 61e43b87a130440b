"""Where a fit has got to, on disk: written after each step of the optimizer, so that a killed fit can go on.

A least-squares fit goes on from its last point. CMA-ES draws the same populations again from its seed and is told the
costs that are known, so it stands exactly where it stood, without a rollout.
"""

from __future__ import annotations

import hashlib
import json
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.files import remove_unfinished, write_text_atomic

FORMAT = "vispeg-checkpoint/1"


@dataclass
class Trace:
    """One optimizer's way so far.

    Attributes:
        u: the point of its last least-squares step in optimizer coordinates, or None before the first.
        generations: costs of each CMA-ES population, in order.
        laps: least-squares steps done.
        cost: the best mean squared whitened residual so far.
        told: called after each step.
    """

    u: np.ndarray | None = None
    generations: list[list[float]] = field(default_factory=list)
    laps: int = 0
    cost: float = math.inf
    told: Callable[[], None] = lambda: None

    def generation(self, costs: list[float]) -> None:
        """A CMA-ES population has been evaluated."""
        self.generations.append([float(c) for c in costs])
        self.cost = min(self.cost, *costs)
        self.told()

    def lap(self, u: np.ndarray, cost: float) -> None:
        """A least-squares step has been made."""
        self.u, self.laps, self.cost = np.array(u), self.laps + 1, float(cost)
        self.told()


class Checkpoint:
    """The traces of all starts of a fit, kept in one file.

    Args:
        file: where; its folder is made.
        key: whatever the fit depends on; a checkpoint of another fit is refused.
        starts: number of traces.
        resume: go on from the file where there is one; otherwise begin anew.
        told: called after each step of any start, with its number and trace.

    Raises:
        UserError: the file is of another fit or cannot be read.
    """

    def __init__(
        self, file: Path, key: Any, starts: int, resume: bool, told: Callable[[int, Trace], None] = lambda i, t: None
    ):
        self.file, self.told = file, told
        self.key = hashlib.sha256(json.dumps(key, sort_keys=True, default=str).encode()).hexdigest()
        self.traces = _read(file, self.key, starts) if resume and file.is_file() else [Trace() for _ in range(starts)]
        self._lock = threading.Lock()  # starts run in threads of their own
        for i, trace in enumerate(self.traces):
            trace.told = lambda i=i: self._told(i)

    def _told(self, i: int) -> None:
        with self._lock:
            self._write()
        self.told(i, self.traces[i])

    def _write(self) -> None:
        rows = [
            {"u": None if t.u is None else t.u.tolist(), "generations": t.generations, "laps": t.laps, "cost": t.cost}
            for t in self.traces
        ]
        text = json.dumps({"format": FORMAT, "key": self.key, "traces": rows})
        write_text_atomic(self.file, text, overwrite=True)

    def remove(self) -> None:
        """The fit is done: nothing is left behind."""
        remove_unfinished(self.file)


def _read(file: Path, key: str, starts: int) -> list[Trace]:
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        rows = data["traces"]
        traces = [
            Trace(
                None if r["u"] is None else np.array(r["u"], float), r["generations"], int(r["laps"]), float(r["cost"])
            )
            for r in rows
        ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError("cannot be read as a checkpoint; remove it to begin anew", file=file) from error
    if data.get("key") != key or len(traces) != starts:
        raise UserError("belongs to another fit; drop --resume to begin anew", file=file)
    return traces
