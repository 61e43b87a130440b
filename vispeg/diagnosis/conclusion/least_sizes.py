"""Minimum size of an effect for a search to find it, from its first-order effect on the readings.

An effect of `c` times a trial size lowers the squared residual of a block by c^2 d^2 + 2 c d e. Here d is the norm of
its whitened trace, projected off the effects of the model, and e the error along that trace. The least c that passes
the tests of the search is computed with errors as large as the residual along the trace.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES

DRAWS = 200  # of the errors of all blocks; a tenth of them may fail the test, by `power`
REACH = (1e-4, 1e4)  # multiples of the trial size among which the least is sought


@dataclass(frozen=True)
class Trace:
    """Trace of one parameter at its trial size in the blocks of some readings.

    Attributes:
        square: (nblock,) squared norm of the whitened trace, projected off the effects of the model.
        alone: the same over all blocks, also projected off the other parameters of its own effect.
        error: standard deviation of the residual along the trace, at least 1, which is that of white noise.
    """

    square: np.ndarray
    alone: float
    error: float

    @classmethod
    def of(cls, column: np.ndarray, others: np.ndarray, residual: np.ndarray, blocks: np.ndarray) -> Trace:
        """Build from a whitened trace (n,), `others` (n, k) of its own effect, and the present residual (n,)."""
        square = np.bincount(blocks, column**2)
        along = np.bincount(blocks, column * residual)
        rest = column - others @ np.linalg.lstsq(others, column, rcond=1e-6)[0] if others.shape[1] else column
        error = float(np.sqrt(max(1.0, np.sum(along**2) / max(square.sum(), 1e-300))))
        return cls(square[square > 0], float(rest @ rest), error)


@dataclass(frozen=True)
class Needs:
    """Acceptance criteria of a search.

    Attributes:
        held_out: required drop of the held-out squared residual; any drop suffices on the fitted recordings.
        level: required standard errors of the gain over the blocks of both.
        loss: held-out squared residual without the effect; a gain that is `large` relative to it needs less
            significance.
    """

    held_out: float
    level: float
    loss: float


def least_coefficient(fitted: Trace, held_out: Trace, needs: Needs) -> float:
    """Return the least multiple of the trial size that passes with probability `power`; infinite if none does."""
    # half an interval that excludes null, plus the scatter of its middle
    ends = 1.96 + float(stats.norm.ppf(RULES.power))
    totals = ((fitted, 0.0), (held_out, needs.held_out))
    least = max(np.sqrt(_surely(t, drop) / max(t.square.sum(), 1e-300)) for t, drop in totals)
    least = max(least, ends * fitted.error / np.sqrt(max(fitted.alone, 1e-300)), REACH[0])
    return _least_that(_ranks(fitted, held_out, needs), float(least))


def least_alone(trace: Trace, drop: float, level: float) -> float:
    """Return the same if only the held-out readings decide: by the drop of their squares, and its ranks over blocks."""
    least = max(float(np.sqrt(_surely(trace, drop) / max(trace.square.sum(), 1e-300))), REACH[0])
    errors = _errors(trace, np.random.default_rng(0))
    return _least_that(lambda times: _passes(_gains(trace, times, errors), level), least)


def _least_that(passes: Callable[[float], bool], least: float) -> float:
    """Return the least multiple from `least` on that passes, by bisection; infinite if none in reach does."""
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
    """Return the range of each parameter that does not show, given its minimum detectable distance from null.

    Args:
        name: of the effect.
        least: by parameter the distance from its null (for a scale its factor); infinite if no size shows.
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
    """Return `times` a trial parameter's distance from null; for a scale the trial's own factor, if that shows."""
    param, value = effect(placed.effect).params[key], placed.params[key].value
    if param.scale == "log":  # no straight line leads from null to such a value
        return max(value / param.null, param.null / value) if times <= 1.0 else float("inf")
    return float(times * abs(value - param.null))


def _surely(trace: Trace, drop: float) -> float:
    """Return the squared trace that lowers the squared residual by `drop` with probability `power`."""
    error = float(stats.norm.ppf(RULES.power)) * trace.error
    return float((error + np.sqrt(error**2 + drop)) ** 2)


def _ranks(fitted: Trace, held_out: Trace, needs: Needs) -> Callable[[float], bool]:
    """Return a test whether Wilcoxon's signed ranks pass at a multiple, over all blocks and over the held-out ones."""
    draw = np.random.default_rng(0)  # the same errors for every size, so that detectability grows with size
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
    """Return errors (draws, nblock) of the blocks' residuals along the trace, times its norm there."""
    return trace.error * np.sqrt(trace.square) * draw.normal(size=(DRAWS, len(trace.square)))


def _gains(trace: Trace, times: float, errors: np.ndarray) -> np.ndarray:
    """Return the drops (draws, nblock) of the blocks' squared residuals."""
    return times**2 * trace.square + 2.0 * times * errors


def _passes(gains: np.ndarray, level: float) -> bool:
    """Return whether the signed ranks of gains (draws, nblock) exceed a level with probability `power`."""
    n = gains.shape[1]
    if not n:
        return False
    positive = np.take_along_axis(gains > 0, np.argsort(np.abs(gains), axis=1), axis=1)
    total = positive @ np.arange(1.0, n + 1)
    scores = (total - n * (n + 1) / 4) / np.sqrt(n * (n + 1) * (2 * n + 1) / 24)
    return float(np.quantile(scores, 1.0 - RULES.power)) >= level
