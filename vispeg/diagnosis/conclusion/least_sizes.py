"""Minimum size of an effect with which a search finds it, to first order in the size.

The trace of a parameter is the whitened change of the readings if the parameter has its trial size, minus the part that
the model's own parameters can make up for. A block is a short piece of a recording, over which a search tests gains
(`selection.judge`). If a robot has the effect at c times the trial size, adding it to the model lowers the squared
residual of a block by c^2 d^2 + 2 c d e. Here d is the norm of the trace in the block, and e the readings' error along
it: whitened, so that white noise has the standard deviation 1; it is taken to be as large as the present residual along
the trace. What is sought is the least c that passes the tests of the search.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.intervals import Z

DRAWS = 200  # draws of the errors e; the test must pass in a share `RULES.power` of them
REACH = (1e-4, 1e4)  # multiples c of the trial size between which the least is sought


@dataclass(frozen=True)
class Trace:
    """Trace of one parameter at its trial size in some readings, as norms.

    Attributes:
        square: (nblock,) squared norm of the trace in each block in which it is not 0.
        alone: squared norm over all readings of the part that the effect's other parameters cannot make up for.
        error: standard deviation of the residual along the trace; at least 1, that of white noise.
    """

    square: np.ndarray
    alone: float
    error: float

    @classmethod
    def of(cls, column: np.ndarray, others: np.ndarray, residual: np.ndarray, blocks: np.ndarray) -> Trace:
        """Build from arrays over n readings.

        Args:
            column: (n,) the trace.
            others: (n, k) traces of the other k parameters of the same effect.
            residual: (n,) whitened residual of the present model.
            blocks: (n,) int, the block of each reading.
        """
        square = np.bincount(blocks, column**2)
        along = np.bincount(blocks, column * residual)
        independent = column - others @ np.linalg.lstsq(others, column, rcond=1e-6)[0] if others.shape[1] else column
        error = float(np.sqrt(max(1.0, np.sum(along**2) / max(square.sum(), 1e-300))))
        return cls(square[square > 0], float(independent @ independent), error)


@dataclass(frozen=True)
class Needs:
    """What a search requires of an effect.

    Attributes:
        held_out: least drop of the squared residual of the held-out recordings; of the fitted ones any drop suffices.
        score: least standard score of the signed ranks of the drops over the blocks of all recordings; over those of
            the held-out ones alone it is the score of the level `RULES.level`.
        loss: squared residual of the held-out recordings that is unrelated to the effect. A drop of at least the share
            `RULES.large` of the whole needs only the score of `RULES.level` over the blocks of all recordings, and
            `RULES.held_out_large` over those of the held-out ones.
    """

    held_out: float
    score: float
    loss: float


def least_coefficient(fitted: Trace, held_out: Trace, needs: Needs) -> float:
    """Return the least multiple of the trial size that a search finds with probability `RULES.power`.

    Infinite if none in REACH is found.

    Args:
        fitted, held_out: traces of the parameter in the fitted and in the held-out recordings.
        needs: what the search requires.
    """
    # standard errors from null to the estimate, so that with `power` the 95 % interval excludes null
    from_null = Z + float(stats.norm.ppf(RULES.power))
    excludes_null = float(from_null * fitted.error / np.sqrt(max(fitted.alone, 1e-300)))
    least = max(_least_that_lowers(fitted, 0.0), _least_that_lowers(held_out, needs.held_out), excludes_null, REACH[0])
    return _least_that(_ranks(fitted, held_out, needs), least)


def least_alone(trace: Trace, drop: float, score: float) -> float:
    """Return the least multiple of the trial size as `least_coefficient` does, if held-out recordings alone decide.

    Args:
        trace: trace of the parameter in these.
        drop: least drop of their squared residual.
        score: least standard score of the signed ranks of the drops over their blocks.
    """
    least = max(_least_that_lowers(trace, drop), REACH[0])
    errors = _errors(trace, np.random.default_rng(0))
    return _least_that(lambda times: _passes(_gains(trace, times, errors), score), least)


def _least_that(passes: Callable[[float], bool], least: float) -> float:
    """Return the least multiple in [`least`, REACH[1]] that passes, by bisection; infinite if none does.

    `passes` must be true for every multiple above one that passes.
    """
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
    """Return for each parameter the range of values, around null, that do not show.

    Args:
        name: name of the effect.
        least: parameter -> least distance from null that shows; of a parameter with a `log` scale the factor from null.
            Infinite if none shows.

    Returns:
        Parameter -> (lowest, highest) value, within its bounds; None if no value within them shows.
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
    """Return the distance from null of `times` the trial size, as `between` takes it.

    A parameter with a `log` scale is not extrapolated: it is the trial's own factor if `times` is 1 or less, else
    infinite.

    Args:
        placed: the trial.
        key: name of the parameter.
        times: least multiple of the trial size that shows.
    """
    param, value = effect(placed.effect).params[key], placed.params[key].value
    if param.scale == "log":
        return max(value / param.null, param.null / value) if times <= 1.0 else float("inf")
    return float(times * abs(value - param.null))


def _least_that_lowers(trace: Trace, drop: float) -> float:
    """Return the multiple at which a trace lowers the squared residual by `drop` with probability `RULES.power`.

    It is the c with c^2 d^2 - 2 c d e = drop, for the norm d of the whole trace and the error e that is exceeded with
    probability 1 - `RULES.power`.
    """
    error = float(stats.norm.ppf(RULES.power)) * trace.error
    return float((error + np.sqrt(error**2 + drop)) / np.sqrt(max(trace.square.sum(), 1e-300)))


def _ranks(fitted: Trace, held_out: Trace, needs: Needs) -> Callable[[float], bool]:
    """Return a function of a multiple: whether Wilcoxon's signed-rank test passes over held-out and over all blocks."""
    draw = np.random.default_rng(0)  # the same errors for every size, so that detectability grows with size
    held_errors, errors = _errors(held_out, draw), _errors(fitted, draw)

    def passes(times: float) -> bool:
        large = times**2 * held_out.square.sum() >= RULES.large * (needs.loss + times**2 * held_out.square.sum())
        of_level = float(stats.norm.isf(RULES.level))
        gains = _gains(held_out, times, held_errors)
        if not _passes(gains, RULES.held_out_large if large else of_level):
            return False
        return _passes(
            np.concatenate([gains, _gains(fitted, times, errors)], axis=1), of_level if large else needs.score
        )

    return passes


def _errors(trace: Trace, draw: np.random.Generator) -> np.ndarray:
    """Draw the products d e (DRAWS, nblock) of each block: norm of the trace times error along it."""
    return trace.error * np.sqrt(trace.square) * draw.normal(size=(DRAWS, len(trace.square)))


def _gains(trace: Trace, times: float, errors: np.ndarray) -> np.ndarray:
    """Return the drops (DRAWS, nblock) of the blocks' squared residuals at a multiple; `errors` are from `_errors`."""
    return times**2 * trace.square + 2.0 * times * errors


def _passes(gains: np.ndarray, score: float) -> bool:
    """Return whether the standard score of the signed ranks of gains (DRAWS, nblock) reaches `score`.

    It must do so in a share `RULES.power` of the draws. Without blocks it does not.
    """
    n = gains.shape[1]
    if not n:
        return False
    positive = np.take_along_axis(gains > 0, np.argsort(np.abs(gains), axis=1), axis=1)
    total = positive @ np.arange(1.0, n + 1)
    scores = (total - n * (n + 1) / 4) / np.sqrt(n * (n + 1) * (2 * n + 1) / 24)
    return float(np.quantile(scores, 1.0 - RULES.power)) >= score
