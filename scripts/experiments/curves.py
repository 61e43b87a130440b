"""Learning curves: one from each run's progress.csv, and several seeds together."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError


@dataclass(frozen=True)
class Curve:
    """Evaluations of one run.

    Attributes:
        steps: (n,) environment steps so far.
        seconds: (n,) wall clock so far, evaluations included.
        success: (n,) success rate, 0 to 1.
        returns: (n,) mean of the episodes' sum of rewards.
        peak_force: (n,) mean of the episodes' largest contact force, N.
    """

    steps: np.ndarray
    seconds: np.ndarray
    success: np.ndarray
    returns: np.ndarray
    peak_force: np.ndarray

    def reaches(self, rate: float) -> int | None:
        """Return the step of the first evaluation with at least this success rate; None if there is none."""
        there = np.flatnonzero(self.success >= rate)
        return int(self.steps[there[0]]) if len(there) else None


def read_curve(path: Path) -> Curve:
    """Return the curve of a run's progress.csv.

    Raises:
        UserError: no such file, or no row in it.
    """
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    except OSError as error:
        raise UserError("not a training run's progress", file=path) from error
    if not rows:
        raise UserError("no evaluation yet", file=path)
    columns = ("seconds", "success", "reward", "peak_force")
    return Curve(np.array([int(r["steps"]) for r in rows]), *(np.array([float(r[k]) for r in rows]) for k in columns))


def together(curves: Sequence[Curve]) -> dict[str, Any]:
    """Combine several seeds at the steps that all of them were evaluated at, ready for JSON.

    Returns:
        {seeds, steps, seconds (mean), mean, low, high, return}: success rates, `low` and `high` the worst and the best
        seed; `return` has mean, low and high likewise.

    Raises:
        UserError: no curve, or no step in common.
    """
    steps = sorted(set.intersection(*(set(c.steps.tolist()) for c in curves))) if curves else []
    if not steps:
        raise UserError("learning curves with no step in common", got=len(curves))
    found = {name: _at(curves, name, steps) for name in ("success", "returns", "seconds")}
    return {
        "seeds": len(curves),
        "steps": steps,
        "seconds": np.round(found["seconds"].mean(0), 4).tolist(),
        **_band(found["success"]),
        "return": _band(found["returns"]),
    }


def _at(curves: Sequence[Curve], name: str, steps: Sequence[int]) -> np.ndarray:
    """Return a quantity (seeds, len(steps)) at these steps."""
    return np.array([getattr(c, name)[np.searchsorted(c.steps, steps)] for c in curves])


def _band(values: np.ndarray) -> dict[str, list[float]]:
    """Return mean, worst and best over seeds of values (seeds, n)."""
    bands = {"mean": values.mean(0), "low": values.min(0), "high": values.max(0)}
    return {name: np.round(band, 4).tolist() for name, band in bands.items()}
