"""Share the simulation of many worlds among processes: rows are independent, and Python slows a single process.

A child process is forked for each share but the first, writes its arrays into shared memory, and ends. No child lives
longer than a call. If a child fails, the parent computes its share again, so that the caller sees the original error.
"""

from __future__ import annotations

import math
import mmap
import os
import signal
import sys
import warnings
from collections.abc import Callable, Sequence

import numpy as np

from vispeg.worlds.world import World

Work = Callable[[Sequence[World]], list[np.ndarray]]
LEAST = 4  # worlds per share: with fewer, a process costs more than it saves


def processes(wanted: int, nworld: int) -> int:
    """Return the useful number of processes for `nworld` worlds, at most `wanted`; 1 if forking is unsafe."""
    return max(1, min(wanted, nworld // LEAST)) if sys.platform == "linux" else 1


def shared(work: Work, worlds: Sequence[World], shapes: Sequence[tuple[int, ...]], count: int) -> list[np.ndarray]:
    """Compute `work(worlds)` by `count` processes.

    Args:
        work: returns float64 arrays whose first axis is the world, one for each of `shapes`.
        worlds: the worlds. Shares are contiguous, as neighbouring worlds often have the same effects and then cost less
            together.
        shapes: shapes of one world's arrays.
        count: number of processes, including this one.
    """
    edges = [len(worlds) * i // count for i in range(count + 1)]
    parts = [worlds[a:b] for a, b in zip(edges, edges[1:], strict=False)]
    answers: list[list[np.ndarray]] = [[]] * count
    children: dict[int, int] = {}  # process id -> share
    try:
        for i in range(1, count):
            answers[i] = _memory([(len(parts[i]), *shape) for shape in shapes])
            children[_fork(work, parts[i], answers[i])] = i
        answers[0] = work(parts[0])
        while children:
            pid, i = next(iter(children.items()))
            status = os.waitpid(pid, 0)[1]
            del children[pid]
            if status != 0:
                answers[i] = work(parts[i])
    finally:
        for pid in children:  # children are left only if this process failed or was interrupted
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
    return [np.concatenate(arrays) for arrays in zip(*answers, strict=True)]


def _fork(work: Work, worlds: Sequence[World], out: list[np.ndarray]) -> int:
    """Fork a child that fills `out` with the results; return its process id."""
    with warnings.catch_warnings():
        # the other threads are optimizers that wait for this result; the child never needs their locks
        warnings.simplefilter("ignore", DeprecationWarning)
        pid = os.fork()
    if pid:
        return pid
    status = 1
    try:
        for array, value in zip(out, work(worlds), strict=True):
            array[:] = value
        status = 0
    except BaseException:  # the parent computes this share again and raises the error
        pass
    finally:
        os._exit(status)  # no exit handlers, no flushing of the parent's buffers


def _memory(shapes: Sequence[tuple[int, ...]]) -> list[np.ndarray]:
    """Allocate arrays in memory shared with child processes."""
    sizes = [8 * math.prod(shape) for shape in shapes]
    memory = mmap.mmap(-1, max(1, sum(sizes)))
    starts = np.cumsum([0, *sizes[:-1]])
    return [
        np.ndarray(shape, np.float64, buffer=memory, offset=int(s)) for shape, s in zip(shapes, starts, strict=True)
    ]
