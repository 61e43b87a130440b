"""CMA-ES, a global search by random populations, within bounds; it can be resumed from the trace of an earlier run."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vispeg.identify.checkpoint import Trace


def minimise(
    costs: Callable[[list[np.ndarray]], Sequence[float]],
    start: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    *,
    sigma: float,
    generations: int,
    rng: np.random.Generator,
    trace: Trace | None = None,
) -> np.ndarray:
    """Return the best point found, by Hansen's `cma`.

    Populations whose costs are in the trace are drawn again but not evaluated, which restores the search's state.
    Source: N. Hansen, The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772.

    Args:
        costs: returns the costs, finite numbers, of a population of points (n,).
        start: (n,) where to begin; no worse point is returned.
        low, high: (n,) bounds.
        sigma: standard deviation of the first population, in the coordinates' own unit.
        generations: most populations.
        rng: seeds the search.
        trace: costs known from an earlier run; each new population is recorded in it.
    """
    import cma

    # a stream of its own, since other optimizers run in threads at the same time and would share NumPy's global one
    randn = np.random.RandomState(int(rng.integers(1, 2**31))).randn
    # seed nan: the global stream is not seeded
    options = {"bounds": [low.tolist(), high.tolist()], "seed": np.nan, "randn": randn, "verbose": -9}
    if len(start) == 1:
        options["maxstd"] = np.inf  # cma 4.5 limits the step to a third of the bounds, which fails with one coordinate
    search = cma.CMAEvolutionStrategy(start, sigma, options)
    evaluated = list(trace.generations) if trace is not None else []
    at_start = np.inf
    for k in range(generations):
        if search.stop():
            break
        points = search.ask()
        if k < len(evaluated):
            values = evaluated[k]
        else:  # the population is drawn around the start; the first one also includes the start
            values = [float(c) for c in costs([np.asarray(x) for x in ([start, *points] if k == 0 else points)])]
            if trace is not None:
                trace.generation(values)
        if k == 0:
            at_start, values = values[0], values[1:]
        search.tell(points, values)
    return np.asarray(start if at_start <= search.result.fbest else search.result.xbest)
