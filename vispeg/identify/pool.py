"""Many library optimizers at once, their rollouts merged into one batch.

Each job is an ordinary function that calls `submit(worlds)` whenever its optimizer wants rollouts. Jobs run in threads;
once every living job waits, all that was asked for is simulated as rows of one batch.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from vispeg.worlds.world import World

T = TypeVar("T")
Submit = Callable[[Sequence[World]], list[np.ndarray]]


def run_together(
    jobs: Sequence[Callable[[Submit], T]],
    evaluate: Submit,
    progress: Callable[[str], None] | None = None,
    most_rows: int = 256,
) -> list[T]:
    """Results of `jobs`, in order; `evaluate` gets the merged requests. The first exception of a job is raised."""
    lock = threading.Condition()
    asked: dict[int, Sequence[World]] = {}
    answers: dict[int, list[np.ndarray] | BaseException] = {}
    done: dict[int, T] = {}
    failed: list[BaseException] = []

    def work(i: int) -> None:
        def submit(worlds: Sequence[World]) -> list[np.ndarray]:
            with lock:
                asked[i] = worlds
                lock.notify_all()
                lock.wait_for(lambda: i in answers)
                answer = answers.pop(i)
            if isinstance(answer, BaseException):
                raise answer
            return answer

        try:
            result = jobs[i](submit)
            with lock:
                done[i] = result
        except BaseException as error:  # handed to the caller's thread
            with lock:
                failed.append(error)
        finally:
            with lock:
                alive.discard(i)
                lock.notify_all()

    alive = set(range(len(jobs)))
    threads = [threading.Thread(target=work, args=(i,), daemon=True) for i in range(len(jobs))]
    for thread in threads:
        thread.start()
    while True:
        with lock:
            lock.wait_for(lambda: len(asked) == len(alive))
            if not alive:
                break
            batch = dict(sorted(asked.items()))
            asked.clear()
        flat = [w for worlds in batch.values() for w in worlds]
        try:
            values: list[np.ndarray] = []
            for start in range(0, len(flat), most_rows):
                values += evaluate(flat[start : start + most_rows])
            replies, at = {}, 0
            for i, worlds in batch.items():
                replies[i] = values[at : at + len(worlds)]
                at += len(worlds)
        except BaseException as error:
            replies = dict.fromkeys(batch, error)
        with lock:
            answers.update(replies)
            lock.notify_all()
        if progress is not None:
            progress(f"{len(flat)} rollouts")
    if failed:
        raise failed[0]
    return [done[i] for i in range(len(jobs))]
