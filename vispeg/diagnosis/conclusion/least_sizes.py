"""The least size of an effect at which a search would find it: by what it does to readings, to first order.

An effect of `c` times a trial's size lowers the squared residual of a block of readings by c^2 d^2 + 2 c d e, where d
is the length of its trace there, beside what the model's effects may take of it, and e an error along that trace. From
which c on that passes the tests of the search is worked out with errors as large as the residual has along the trace.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES

DRAWS = 200  # of the errors of all blocks: one in ten of them says what `power` leaves
REACH = (1e-4, 1e4)  # of a trial's size, between which the least one is sought


@dataclass(frozen=True)
class Trace:
    """What one parameter at a trial's size does to the blocks of some readings.

    Attributes:
        square: (nblock,) squared length of the whitened trace, beside what the effects of the model take of it.
        alone: the same of all blocks, beside what the other parameters of its own effect take, too.
        error: standard deviation along the trace of what is left, 1 or more: of white noise 1.
    """

    square: np.ndarray
    alone: float
    error: float

    @classmethod
    def of(cls, column: np.ndarray, others: np.ndarray, residual: np.ndarray, blocks: np.ndarray) -> Trace:
        """Of a whitened trace (n,), beside `others` (n, k) of its own effect, and what is left (n,) at present."""
        square = np.bincount(blocks, column**2)
        along = np.bincount(blocks, column * residual)
        rest = column - others @ np.linalg.lstsq(others, column, rcond=1e-6)[0] if others.shape[1] else column
        error = float(np.sqrt(max(1.0, np.sum(along**2) / max(square.sum(), 1e-300))))
        return cls(square[square > 0], float(rest @ rest), error)


@dataclass(frozen=True)
class Needs:
    """What a search asks for before it accepts an effect.

    Attributes:
        held_out: drop of the squared residual of the held-out recordings; of the fitted ones any drop is enough.
        level: standard errors of the gain over the blocks of both.
        loss: held-out squared residual without the effect; of a gain that is `large` beside it less is asked.
    """

    held_out: float
    level: float
    loss: float


def least_coefficient(fitted: Trace, held_out: Trace, needs: Needs) -> float:
    """Of a trial's size the least multiple that passes with the probability `power`; infinite where none does."""
    # half an interval that leaves out none, and how its middle may lie
    ends = 1.96 + float(stats.norm.ppf(RULES.power))
    totals = ((fitted, 0.0), (held_out, needs.held_out))
    least = max(np.sqrt(_surely(t, drop) / max(t.square.sum(), 1e-300)) for t, drop in totals)
    least = max(least, ends * fitted.error / np.sqrt(max(fitted.alone, 1e-300)), REACH[0])
    return _least_that(_ranks(fitted, held_out, needs), float(least))


def least_alone(trace: Trace, drop: float, level: float) -> float:
    """Give the same where the readings that judge decide alone: by the drop of their squares and ranks over blocks."""
    least = max(float(np.sqrt(_surely(trace, drop) / max(trace.square.sum(), 1e-300))), REACH[0])
    errors = _errors(trace, np.random.default_rng(0))
    return _least_that(lambda times: _passes(_gains(trace, times, errors), level), least)


def _least_that(passes: Callable[[float], bool], least: float) -> float:
    """Give the least multiple from `least` on that passes, by halving; infinite where none in reach does."""
    if least > REACH[1]:
        return float("inf")
    if passes(least):
        return least
    low, high = np.log(least), np.log(REACH[1])
    for _ in range(24):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if passes(float(np.exp(middle))) else (middle, high)
    return float(np.exp(high)) if high < np.log(REACH[1]) - 1e-3 else float("inf")


def between(name: str, least: Mapping[str, float]) -> dict[str, tuple[float, float] | None]:
    """Give the values of each of an effect's parameters that do not show, by how far from none it does: as far as it
    may go.

    Args:
        name: of the effect.
        least: by parameter the distance from its null; of a scale its factor; infinite where no size shows.
    """
    hidden: dict[str, tuple[float, float] | None] = {}
    for key, size in least.items():
        param = effect(name).params[key]
        ends = (
            (param.null / size, param.null * size) if param.scale == "log" else (param.null - size, param.null + size)
        )
        reached = np.isfinite(size) and (ends[0] >= param.low or ends[1] <= param.high)
        hidden[key] = (max(ends[0], param.low), min(ends[1], param.high)) if reached else None
    return hidden


def distance(placed: EffectInstance, key: str, times: float) -> float:
    """So many times as far from none as a trial's parameter; of a scale the trial's own factor where that shows."""
    param, value = effect(placed.effect).params[key], placed.params[key].value
    if param.scale == "log":  # no line leads from null to such a value
        return max(value / param.null, param.null / value) if times <= 1.0 else float("inf")
    return float(times * abs(value - param.null))


def _surely(trace: Trace, drop: float) -> float:
    """Squared trace that lowers the squared residual by so much with the probability `power`."""
    error = float(stats.norm.ppf(RULES.power)) * trace.error
    return float((error + np.sqrt(error**2 + drop)) ** 2)


def _ranks(fitted: Trace, held_out: Trace, needs: Needs) -> Callable[[float], bool]:
    """Whether Wilcoxon's signed ranks over blocks pass at a multiple, of all blocks and of the held-out ones alone."""
    draw = np.random.default_rng(0)  # the same errors for every size, so that a greater one shows no less
    held_errors, errors = _errors(held_out, draw), _errors(fitted, draw)

    def passes(times: float) -> bool:
        large = times**2 * held_out.square.sum() >= RULES.large * (needs.loss + times**2 * held_out.square.sum())
        level = float(stats.norm.isf(RULES.large_level)) if large else needs.level
        gains = _gains(held_out, times, held_errors)
        if not _passes(gains, RULES.held_out_large if large else RULES.held_out):
            return False
        return _passes(np.concatenate([gains, _gains(fitted, times, errors)], axis=1), level)

    return passes


def _errors(trace: Trace, draw: np.random.Generator) -> np.ndarray:
    """(draws, nblock) errors of the blocks' residuals along the trace, times its length there."""
    return trace.error * np.sqrt(trace.square) * draw.normal(size=(DRAWS, len(trace.square)))


def _gains(trace: Trace, times: float, errors: np.ndarray) -> np.ndarray:
    """(draws, nblock) drops of the blocks' squared residuals."""
    return times**2 * trace.square + 2.0 * times * errors


def _passes(gains: np.ndarray, level: float) -> bool:
    """Whether the signed ranks of gains (draws, nblock) are above a level with the probability `power`."""
    n = gains.shape[1]
    if not n:
        return False
    positive = np.take_along_axis(gains > 0, np.argsort(np.abs(gains), axis=1), axis=1)
    total = positive @ np.arange(1.0, n + 1)
    scores = (total - n * (n + 1) / 4) / np.sqrt(n * (n + 1) * (2 * n + 1) / 24)
    return float(np.quantile(scores, 1.0 - RULES.power)) >= level
