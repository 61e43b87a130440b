"""Run jobs on a Ray cluster: the one at RAY_ADDRESS, else a new one on this machine that listens only on loopback.

Every node needs an installed vispeg, and the files that a job names at the same paths. Results come back through Ray's
object store. If a worker is killed, its job is run again.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal, TypeVar

from vispeg.core.errors import UserError
from vispeg.core.extras import missing
from vispeg.core.workers import THREADS

Engine = Literal["local", "ray"]
J = TypeVar("J")
R = TypeVar("R")
TRIES = 3  # a job that has lost this many workers is given up
CONNECT = 10  # s, timeout of a connection
# Environment variable that Ray reads when it is imported. In spite of its name it decides on every system whether other
# nodes may join.
CLUSTER = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"


def on_ray(
    work: Callable[[J], R], jobs: Sequence[J], workers: int, *, what: str, tasks: int | None = None
) -> Iterator[tuple[J, R]]:
    """Run jobs on a cluster, each on one core, and yield each job with its result, in any order.

    Args:
        work: function that does a job; it is sent by value, once for all jobs.
        jobs: in the order in which they begin.
        workers: number of jobs at a time.
        what: noun for a job in error messages, such as "shard".
        tasks: number of jobs after which a process is replaced; None for never.

    Raises:
        UserError: Ray is not installed, its cluster cannot be reached, or a job killed its worker `TRIES` times; also
            any UserError that a job raises.
    """
    with cluster(workers) as ray:
        yield from _tasks(ray, work, jobs, workers, what, tasks)


@contextmanager
def cluster(workers: int) -> Iterator[Any]:
    """Connect to Ray for the body, so that several calls of `on_ray` share the connection; yields the module `ray`.

    Raises:
        UserError: Ray is not installed, or its cluster cannot be reached.
    """
    ray = _ray()
    started_here = not ray.is_initialized()
    if started_here:
        _connect(ray, workers)
    try:
        yield ray
    finally:
        if started_here:
            ray.shutdown()


def _tasks(
    ray: Any, work: Callable[[J], R], jobs: Sequence[J], workers: int, what: str, tasks: int | None
) -> Iterator[tuple[J, R]]:
    call = ray.remote(num_cpus=1, max_retries=0, max_calls=tasks or 0)(_call)
    sent = ray.put(work)  # once for all jobs: it may hold recordings
    remaining, running, deaths = list(range(len(jobs))), {}, [0] * len(jobs)
    while remaining or running:
        while remaining and len(running) < max(1, workers):
            number = remaining.pop(0)
            running[call.remote(sent, jobs[number])] = number
        ready, _ = ray.wait(list(running), num_returns=1)
        for reference in ready:
            number = running.pop(reference)
            try:
                result = ray.get(reference)
            except ray.exceptions.RayTaskError as error:
                if isinstance(error.cause, UserError):
                    raise UserError(str(error.cause)) from None
                raise
            except ray.exceptions.RayError as error:  # the worker or its node died
                deaths[number] += 1
                if deaths[number] >= TRIES:
                    lost = f"{what} {number + 1} of {len(jobs)} lost its worker {TRIES} times"
                    raise UserError(lost, got=type(error).__name__) from None
                remaining.insert(0, number)
                continue
            yield jobs[number], result


def _call(work: Callable[[J], R], job: J) -> R:
    return work(job)


def _ray() -> Any:
    if not os.environ.get("RAY_ADDRESS"):
        os.environ.setdefault(CLUSTER, "0")
    try:
        import ray
    except ImportError:
        raise missing("ray", "work on a cluster", key="engine") from None
    return ray


def _connect(ray: Any, workers: int) -> None:
    address = os.environ.get("RAY_ADDRESS")
    environment = {"env_vars": dict.fromkeys(THREADS, "1") | _set_here("MUJOCO_GL", "PYTHONPATH")}
    quiet = {"log_to_driver": False, "logging_level": "error", "runtime_env": environment}
    try:
        if address:
            _check_listening(address)
            ray.init(address=address, **quiet)
        else:
            ray.init(num_cpus=max(1, workers), include_dashboard=False, **quiet)
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        reason = " ".join(str(error).split())[:120]
        raise UserError(f"the Ray cluster cannot be reached ({reason})", key="RAY_ADDRESS", got=address) from None


def _check_listening(address: str) -> None:
    """Raise OSError if nothing listens at HOST:PORT; Ray itself would try for ten minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECT).close()


def _set_here(*names: str) -> dict[str, str]:
    """Return those of these environment variables that are set in this process."""
    return {name: os.environ[name] for name in names if name in os.environ}
