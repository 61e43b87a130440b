"""Run the cases of a benchmark, a few at a time, in threads or on a Ray cluster that has access to the same folder."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Literal, TypeVar

C = TypeVar("C")
R = TypeVar("R")
Engine = Literal["local", "ray"]
ENGINES: tuple[Engine, ...] = ("local", "ray")


def each(work: Callable[[C], R], cases: Sequence[C], workers: int, engine: Engine = "local") -> Iterator[tuple[C, R]]:
    """Yield each case with the result of `work`, in the order in which they finish."""
    if engine == "ray":
        from vispeg.core.cluster import on_ray

        os.environ["PYTHONPATH"] = os.pathsep.join(map(str, sys.path))  # of the workers: `work` goes there by its name
        yield from on_ray(work, cases, workers, what="case")
        return
    if workers == 1:  # where a picture is drawn, the driver wants the main thread
        yield from ((case, work(case)) for case in cases)
        return
    with ThreadPoolExecutor(workers) as pool:
        waiting = {pool.submit(work, case): case for case in cases}
        for done in as_completed(waiting):
            yield waiting[done], done.result()
