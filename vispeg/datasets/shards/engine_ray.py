"""Makes shards on a Ray cluster: the one at RAY_ADDRESS, or one of its own on this machine, which listens on loopback.

Every node needs vispeg installed and the world's file at the same path. Bytes come back through Ray's object store.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Sequence
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.extras import missing
from vispeg.core.workers import THREADS
from vispeg.datasets.layout import Layout
from vispeg.datasets.shards.engine import TRIES, Made
from vispeg.datasets.shards.plan import Plan, Shard
from vispeg.datasets.shards.shard import Source, shard_bytes

CONNECT = 10  # s
CLUSTER = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"  # Ray's, of every system: whether others may join; read at its import


def on_ray(
    shards: Sequence[Shard], source: Source, plan: Plan, layout: Layout, workers: int, tick: Callable[[int], None]
) -> Made:
    """As `engine.local`: `workers` shards at a time, each on one core. A killed worker's shard is made again.

    Raises:
        UserError: Ray is not installed, its cluster cannot be reached, a shard killed its worker again and again.
    """
    ray = _ray()
    started_here = not ray.is_initialized()
    if started_here:
        _connect(ray, workers)
    try:
        yield from _tasks(ray, shards, source, plan, layout, workers, tick)
    finally:
        if started_here:
            ray.shutdown()


def _tasks(
    ray: Any,
    shards: Sequence[Shard],
    source: Source,
    plan: Plan,
    layout: Layout,
    workers: int,
    tick: Callable[[int], None],
) -> Made:
    make = ray.remote(num_cpus=1, max_retries=0)(shard_bytes)
    remaining, waiting, deaths = list(shards), {}, dict.fromkeys([s.number for s in shards], 0)
    while remaining or waiting:
        while remaining and len(waiting) < max(1, workers):
            shard = remaining.pop(0)
            waiting[make.remote(source, plan, layout, shard)] = shard
        ready, _ = ray.wait(list(waiting), num_returns=1)
        for reference in ready:
            shard = waiting.pop(reference)
            try:
                data = ray.get(reference)
            except ray.exceptions.RayTaskError as error:
                if isinstance(error.cause, UserError):
                    raise UserError(str(error.cause)) from None
                raise
            except ray.exceptions.RayError as error:  # the worker or its node died
                deaths[shard.number] += 1
                if deaths[shard.number] >= TRIES:
                    raise UserError(
                        f"shard {shard.number} lost its worker {TRIES} times", got=type(error).__name__
                    ) from None
                remaining.insert(0, shard)
                continue
            tick(shard.frames)
            yield shard, data


def _ray() -> Any:
    if not os.environ.get("RAY_ADDRESS"):
        os.environ.setdefault(CLUSTER, "0")
    try:
        import ray
    except ImportError:
        raise missing("ray", "rendering on a cluster", key="engine") from None
    return ray


def _connect(ray: Any, workers: int) -> None:
    address = os.environ.get("RAY_ADDRESS")
    environment = {"env_vars": dict.fromkeys(THREADS, "1") | _kept("MUJOCO_GL")}
    quiet = {"log_to_driver": False, "logging_level": "error", "runtime_env": environment}
    try:
        if address:
            _knock(address)
            ray.init(address=address, **quiet)
        else:
            ray.init(num_cpus=max(1, workers), include_dashboard=False, **quiet)
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        reason = " ".join(str(error).split())[:120]
        raise UserError(f"the Ray cluster cannot be reached ({reason})", key="RAY_ADDRESS", got=address) from None


def _knock(address: str) -> None:
    """Raises OSError where nobody listens at HOST:PORT; Ray itself tries for ten minutes before it says so."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECT).close()


def _kept(*names: str) -> dict[str, str]:
    return {name: os.environ[name] for name in names if name in os.environ}
