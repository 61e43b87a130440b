"""Run many optimizers (jobs) concurrently and merge their rollouts into one batch, which is far faster.

Each job is an ordinary function that calls `submit(worlds)` whenever its optimizer needs rollouts, and gets the
residuals of the worlds. Jobs run in threads. Once every running job waits, all requests are simulated as rows of one
batch, or of several if the answers would not fit in memory.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from vispeg.worlds.world import World

T = TypeVar("T")
Submit = Callable[[Sequence[World]], list[np.ndarray]]
AT_ONCE = 128e6  # bytes of answers waiting for their jobs


def run_together(
    jobs: Sequence[Callable[[Submit], T]],
    evaluate: Submit,
    progress: Callable[[str], None] | None = None,
    turn: Callable[[], None] = lambda: None,
    length: int = 1,
    at_once: float = AT_ONCE,
) -> list[T]:
    """Return the results of the jobs, in order; the first exception of a job is raised once all have ended.

    Args:
        jobs: functions of `submit`.
        evaluate: returns the residuals of worlds; it gets the merged requests.
        progress: called with a message after each round of requests.
        turn: called each time all jobs wait, before any is answered.
        length: number of entries of a residual.
        at_once: bytes of residuals that are computed at a time, though at least one job's request.
    """
    lock = threading.Condition()
    asked: dict[int, Sequence[World]] = {}
    answers: dict[int, list[np.ndarray] | BaseException] = {}
    done: dict[int, T] = {}
    failed: list[BaseException] = []

    def work(i: int) -> None:
        """Run job number `i`, in its own thread."""

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
        except BaseException as error:  # re-raised in the caller's thread
            with lock:
                failed.append(error)
        finally:
            with lock:
                alive.discard(i)
                lock.notify_all()

    def reply(i: int, answer: list[np.ndarray] | BaseException) -> None:
        """Answer one job and wait until it asks again or ends, since a job's arrays are as long as the recordings."""
        with lock:
            del asked[i]
            answers[i] = answer
            del answer
            lock.notify_all()
            lock.wait_for(lambda: i in asked or i not in alive)

    alive = set(range(len(jobs)))
    threads = [threading.Thread(target=work, args=(i,), daemon=True) for i in range(len(jobs))]
    for thread in threads:
        thread.start()
    while True:
        with lock:
            lock.wait_for(lambda: len(asked) == len(alive))
            if not alive:
                break
            waiting = dict(sorted(asked.items()))
        turn()
        rows = sum(map(len, waiting.values()))
        while waiting:
            chosen = _first(waiting, at_once / (8 * length))
            failure, values = None, list[np.ndarray]()  # values: the last one first, so that `pop` takes the next
            try:
                values += evaluate([w for i in chosen for w in waiting[i]])[::-1]
            except BaseException as error:
                failure, chosen = error, [*waiting]  # all waiting jobs get the error
            for i in chosen:
                count = len(waiting.pop(i))
                reply(i, failure or [values.pop() for _ in range(count)])
        if progress is not None:
            progress(f"{rows} rollouts")
    if failed:
        raise failed[0]
    return [done[i] for i in range(len(jobs))]


def _first(waiting: Mapping[int, Sequence[World]], rows: float) -> list[int]:
    """Return the first jobs whose requests together have at most `rows` rows, at least one job."""
    total = np.cumsum([len(worlds) for worlds in waiting.values()])
    return [*waiting][: max(1, int(np.sum(total <= rows)))]
