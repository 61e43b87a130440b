"""Worker processes of one thread each: parallelism is by processes; additional threads would only compete for the
cores.
"""

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
    count: int, tasks: int | None = None, initializer: Callable[..., None] | None = None, initargs: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Give a pool of processes that end with this one, however it ends.

    An interrupt from the terminal reaches this process alone. Where the body raises, what the workers are at is given
    up at once; after it they finish it.

    Args:
        count: processes.
        tasks: jobs after which a process is replaced; None: it stays.
        initializer, initargs: called in each process first.
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
    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As the base class does; processes that it starts never see an interrupt."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # processes and threads inherit it
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(initializer: Callable[..., None] | None, initargs: tuple[Any, ...]) -> None:
    threading.Thread(target=end_with_parent, daemon=True).start()
    if initializer is not None:
        initializer(*initargs)


def end_with_parent() -> None:
    """Wait for the parent's end, then end this process."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()  # a killed parent cannot say that there is nothing more to do
        os._exit(1)


@contextmanager
def one_thread() -> Iterator[None]:
    """Let processes that start meanwhile compute with one thread each."""
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
