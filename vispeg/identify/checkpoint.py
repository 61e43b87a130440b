"""Save the progress of a fit to disk after each evaluation, so that a killed fit can resume.

A resumed optimizer starts from the beginning and gets the known answers without a rollout: the costs of its candidate
starting points, of each CMA-ES population (drawn again from the same seed), and of each point of least squares. It
therefore reaches exactly the same state and ends with the same bits. A trace is the stored progress of one optimizer.
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
from vispeg.formats.format import Format, enrol
from vispeg.formats.guard import MB, as_written
from vispeg.formats.typed import typed

FORMAT = "vispeg-checkpoint/3"
# finite=False: before its first step a trace has an infinite cost
CHECKPOINT = Format(FORMAT, "a checkpoint of a fit", ("key", "traces"), language="json", most=256 * MB, finite=False)


@dataclass
class Trace:
    """Progress of one optimizer.

    Attributes:
        candidates: costs of the candidate starting points; empty before their evaluation.
        generations: costs of each CMA-ES population, in order.
        points: least-squares evaluations in order: coordinates, and the array (n + 1, n + 1) of `Point.answer`.
        laps: least-squares steps done.
        cost: the best mean squared whitened residual so far.
        watch: called after each evaluation and each step.
    """

    candidates: list[float] = field(default_factory=list)
    generations: list[list[float]] = field(default_factory=list)
    points: list[tuple[list[float], list[list[float]]]] = field(default_factory=list)
    laps: int = 0
    cost: float = math.inf
    watch: Callable[[], None] = lambda: None

    def chosen(self, costs: list[float]) -> None:
        """Record the costs of the candidate starting points."""
        self.candidates = [float(c) for c in costs]
        self.watch()

    def generation(self, costs: list[float]) -> None:
        """Record the costs of a CMA-ES population."""
        self.generations.append([float(c) for c in costs])
        self.cost = min(self.cost, *costs)
        self.watch()

    def point(self, u: np.ndarray, answer: np.ndarray) -> None:
        """Record a least-squares evaluation."""
        self.points.append((u.tolist(), answer.tolist()))
        self.watch()

    def lap(self, laps: int, cost: float) -> None:
        """Record the number of least-squares steps made and the best cost."""
        self.laps, self.cost = laps, float(cost)
        self.watch()


KEPT = ("candidates", "generations", "points", "laps", "cost")  # stored fields of a trace


class Checkpoint:
    """The traces of all starts of a fit, kept in one file.

    Args:
        file: of the checkpoint; its folder is made.
        key: everything that the fit depends on; a checkpoint of another fit is refused.
        starts: number of optimizers, hence of traces.
        resume: go on from the file if there is one; otherwise begin anew.
        watch: called after each evaluation and step of any optimizer, with its number and trace.

    Raises:
        UserError: the file to resume from is of another fit or cannot be read.
    """

    def __init__(
        self, file: Path, key: Any, starts: int, resume: bool, watch: Callable[[int, Trace], None] = lambda i, t: None
    ):
        self.file, self.watch = file, watch
        self.key = hashlib.sha256(json.dumps(key, sort_keys=True, default=str).encode()).hexdigest()
        self.traces = _read(file, self.key, starts) if resume and file.is_file() else [Trace() for _ in range(starts)]
        self._lock = threading.Lock()  # starts run in separate threads
        for i, trace in enumerate(self.traces):
            trace.watch = lambda i=i: self._stepped(i)

    def _stepped(self, i: int) -> None:
        with self._lock:
            self._write()
        self.watch(i, self.traces[i])

    def _write(self) -> None:
        rows = [{name: getattr(t, name) for name in KEPT} for t in self.traces]
        text = json.dumps({"format": FORMAT, "key": self.key, "traces": rows})
        write_text_atomic(self.file, text, overwrite=True)

    def remove(self) -> None:
        """Delete the file after the fit is done."""
        remove_unfinished(self.file)


def _example(folder: Path) -> Path:
    checkpoint = Checkpoint(folder / "fit" / "checkpoint.json", "example", 2, resume=False)
    checkpoint.traces[0].generation([3.0, 2.0])
    checkpoint.traces[1].point(np.array([0.1, 0.2]), np.eye(3))
    checkpoint.traces[1].lap(1, 1.5)
    return checkpoint.file


@enrol(FORMAT, _example)
def _resumed(file: Path) -> list[Trace]:
    return Checkpoint(file, "example", 2, resume=True).traces


def _read(file: Path, key: str, starts: int) -> list[Trace]:
    with as_written(file, "vispeg fit", "remove it to begin anew"):
        data = CHECKPOINT.read(file)
        rows = [{name: row[name] for name in KEPT} for row in data["traces"]]
        stored_key, traces = data["key"], [typed(Trace, row, file, f"traces[{i}]") for i, row in enumerate(rows)]
    if stored_key != key or len(traces) != starts:
        raise UserError("belongs to another fit; drop --resume to begin anew", file=file)
    return traces
