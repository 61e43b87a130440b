"""Pools of worker processes with one thread each, as more threads would only compete for the cores."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def pool_of(
    count: int, tasks: int | None, initializer: Callable[..., None] | None = None, initargs: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Create a pool of worker processes, which always end with this process.

    An interrupt from the terminal reaches only this process. If the body raises, the workers are killed; otherwise
    they finish their jobs after the body.

    Args:
        count: number of processes.
        tasks: number of jobs after which a process is replaced; None for never.
        initializer: called first in each process; None for nothing.
        initargs: arguments of `initializer`.
    """
    context = multiprocessing.get_context("spawn")
    with one_thread():
        pool = _Pool(count, context, _begin, (initializer, initargs), max_tasks_per_child=tasks)
        try:
            yield pool
            pool.shutdown()
        except BaseException:
            for process in list((pool._processes or {}).values()):
                process.kill()
            pool.shutdown(cancel_futures=True)
            raise


class _Pool(ProcessPoolExecutor):
    """A pool whose processes an interrupt from the terminal does not reach."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a job as the base class does; processes that it starts are shielded from interrupts."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # processes and threads inherit it
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(initializer: Callable[..., None] | None, initargs: tuple[Any, ...]) -> None:
    """Begin a worker process."""
    threading.Thread(target=end_with_parent, daemon=True).start()
    if initializer is not None:
        initializer(*initargs)


def end_with_parent() -> None:
    """Wait for the parent's end, then end this process."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()  # a killed parent cannot tell its workers to end
        os._exit(1)


@contextmanager
def one_thread() -> Iterator[None]:
    """Let processes that start during the body compute with one thread each."""
    before = {key: os.environ.get(key) for key in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for key, value in before.items():
            if value is None:
                os.environ.pop(key, None)
            else:
                os.environ[key] = value
