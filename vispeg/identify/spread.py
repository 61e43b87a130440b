"""Evaluate residuals of many worlds on a Ray cluster, e.g. CMA-ES populations, with the same results as locally."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import partial
from uuid import uuid4

import numpy as np

from vispeg.core.cluster import on_ray
from vispeg.identify.evidence import Evidence
from vispeg.identify.pool import Submit
from vispeg.worlds.world import World

_made: OrderedDict[str, Evidence] = OrderedDict()  # evidence that this worker process has built, by name
KEPT = 2  # largest number of evidences kept


def spread(make: Callable[[], Evidence], workers: int) -> Submit:
    """Return a function that evaluates worlds on a cluster in `workers` parallel parts.

    Args:
        make: builds the evidence, once in each worker process, to which it is sent.
        workers: number of processes, each on one core.
    """
    name = uuid4().hex

    def evaluate(worlds: Sequence[World]) -> list[np.ndarray]:
        count = max(1, min(workers, len(worlds)))
        edges = [len(worlds) * i // count for i in range(count + 1)]
        parts = [(i, [*worlds[a:b]]) for i, (a, b) in enumerate(zip(edges, edges[1:], strict=False))]
        done = on_ray(partial(_residuals, name, make), parts, workers, what="part of the worlds")
        found = {number: residuals for (number, _), residuals in done}
        return [residual for number in sorted(found) for residual in found[number]]

    return evaluate


def _residuals(name: str, make: Callable[[], Evidence], part: tuple[int, Sequence[World]]) -> list[np.ndarray]:
    """Return the residuals of the worlds in `part` (its number, its worlds); runs in a worker."""
    if name not in _made:
        _made[name] = make()
        while len(_made) > KEPT:
            _made.popitem(last=False)
    return _made[name].residuals(part[1])
