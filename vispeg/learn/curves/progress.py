"""The progress of a run: progress.csv, and a bar or lines on the terminal."""

from __future__ import annotations

import csv
import io
import math
import sys
import time
from collections import Counter, deque
from collections.abc import Mapping
from pathlib import Path
from typing import NotRequired, TypedDict

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from vispeg.core.files import write_text_atomic
from vispeg.formats.guard import MB, as_written, read_text
from vispeg.learn.methods.ranges import Opening

COLUMNS = (
    "steps",
    "seconds",
    "updates",
    "stage",
    "success",
    "reward",
    "peak_force",
    "episode_steps",
    "train_success",
    "level",
    "failures",
    "critic_loss",
    "actor_loss",
    "entropy",
    "temperature",
)


class Row(TypedDict):
    """A row of progress.csv; see docs/learning.md for what the columns mean."""

    steps: int
    seconds: float
    updates: int
    stage: int | str
    success: float
    reward: float
    peak_force: float
    episode_steps: float
    failures: str
    critic_loss: float | None
    actor_loss: float | None
    entropy: float | None
    temperature: float | None
    train_success: NotRequired[float]
    level: NotRequired[float | None]


class Table:
    """progress.csv: one row per evaluation. Rows after the step from which a run resumes are dropped.

    `stage` is the index of the curriculum's stage, or `distill K` for round K of a distillation, where `steps` counts
    those of teacher and student together. `level` is how far the world's ranges are open, 0 to 1; empty where they are
    fully open throughout.

    Args:
        path: the file, which may not exist yet.
        upto: reinforcement steps from which the run resumes.
        rounds: number of finished rounds of its distillation; by default all count as finished.
    """

    def __init__(self, path: Path, upto: int, rounds: float = math.inf):
        self.path = path
        self.rows: list[dict[str, str]] = []
        if path.is_file():
            with as_written(path, "vispeg train"):
                stored = list(csv.DictReader(io.StringIO(read_text(path, 64 * MB), newline="")))
                self.rows = [r for r in stored if _remains(r, upto, rounds)]

    @property
    def seconds(self) -> float:
        """Wall-clock time of the run at the last row, s; 0 without rows."""
        return float(self.rows[-1]["seconds"]) if self.rows else 0.0

    def add(self, row: Row) -> None:
        """Add a row and rewrite the whole file."""
        self.rows.append({name: _cell(row.get(name)) for name in COLUMNS})
        lines = [",".join(COLUMNS), *(",".join(str(row.get(name, "")) for name in COLUMNS) for row in self.rows)]
        write_text_atomic(self.path, "\n".join(lines) + "\n", overwrite=True)


class Watch(BaseCallback):
    """Record the outcomes of training episodes, show them on the bar, and set the ranges of the next episodes.

    Args:
        bar: shows the progress.
        recent: success and category of the last episodes, newest last; this object appends to it.
        opening: opens the ranges; None where they are fully open throughout.
    """

    def __init__(self, bar: Bar, recent: deque[tuple[bool, str]], opening: Opening | None = None):
        super().__init__()
        self.bar, self.recent, self.opening = bar, recent, opening

    def _on_step(self) -> bool:
        for row in np.flatnonzero(self.locals["dones"]):
            info = self.locals["infos"][row]
            self.recent.append((bool(info.get("success", False)), str(info.get("category", "timeout"))))
        if self.opening is not None:
            ended = self.locals["dones"], self.locals["infos"]
            self.opening.after(self.training_env, self.num_timesteps, *ended)
        self.bar.at(self.num_timesteps, self.success)
        return True

    @property
    def success(self) -> float:
        """Share of successes among the recent training episodes."""
        return float(np.mean([success for success, _ in self.recent])) if self.recent else 0.0


class Bar:
    """Show a progress bar on a terminal, or one line per evaluation where stderr is not one.

    Args:
        total: value of `steps` at the end.
        show: False to show nothing.
    """

    def __init__(self, total: int, show: bool):
        self.total, self.show, self.live, self.shown = total, show, None, 0.0  # shown: time of the last update, s
        if show and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self.live = Progress(*columns, console=Console(stderr=True))
            self.job = self.live.add_task("training", total=total)

    def __enter__(self) -> Bar:
        if self.live is not None:
            self.live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.live is not None:
            self.live.stop()

    def at(self, steps: int, success: float) -> None:
        """Move the bar to this step and show this success rate, at most five times a second."""
        if self.live is not None and time.monotonic() - self.shown > 0.2:
            self.shown = time.monotonic()
            self.live.update(
                self.job, completed=min(steps, self.total), description=f"training, success {success:4.0%}"
            )

    def say(self, line: str) -> None:
        """Print a line that stays above the bar."""
        if self.live is not None:
            self.live.console.print(line, highlight=False)
        elif self.show:
            print(line, file=sys.stderr, flush=True)


def failures(categories: list[str]) -> str:
    """Return the count of each failure category as text such as `jam 3 search 1`, most frequent first."""
    counted = Counter(category for category in categories if category != "success")
    return " ".join(f"{name} {number}" for name, number in counted.most_common())


def _remains(row: Mapping[str, str], upto: int, rounds: float) -> bool:
    """Return whether a stored row stays when a run resumes; arguments as for Table."""
    if row["stage"].isdigit():
        return int(row["steps"]) <= upto
    return int(row["stage"].removeprefix("distill ")) < rounds


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.5g}" if isinstance(value, float) else str(value)
