"""Make shards in single-threaded worker processes or on a Ray cluster; the shard of a lost worker is repeated."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any

from vispeg.core.cluster import TRIES
from vispeg.core.cluster import on_ray as done_on_ray
from vispeg.core.errors import UserError
from vispeg.core.workers import pool_of
from vispeg.datasets.layout import Layout
from vispeg.datasets.shards.plan import Plan, Shard
from vispeg.datasets.shards.shard import Source, shard_bytes
from vispeg.render.backends.backend import jobs_a_process

POLL = 0.3  # s, interval of progress reports
Made = Iterator[tuple[Shard, bytes]]
Engine = Callable[[Sequence[Shard], Source, Plan, Layout, int, Callable[[int], None]], Made]


def local(
    shards: Sequence[Shard], source: Source, plan: Plan, layout: Layout, workers: int, tick: Callable[[int], None]
) -> Made:
    """Make shards on this machine; yield each with its bytes when it is done.

    Args:
        shards: the shards to make.
        source, plan, layout: content and format of the dataset.
        workers: number of processes; 0 works in this process.
        tick: called with the number of frames just done.

    Raises:
        UserError: an error of the source, or a shard kills its worker repeatedly.
    """
    if workers < 1:
        yield from ((s, shard_bytes(source, plan, layout, s, tick)) for s in shards)
        return
    todo, deaths = list(shards), 0
    while todo:
        done: set[int] = set()
        try:
            for shard, data in _pool(todo, source, plan, layout, workers, tick):
                done.add(shard.number)
                yield shard, data
        except BrokenProcessPool:
            deaths = 1 if done else deaths + 1
            if deaths >= TRIES:
                raise UserError("workers die repeatedly; is there enough memory?", key="workers", got=workers) from None
        todo = [s for s in todo if s.number not in done]


def _pool(
    shards: Sequence[Shard], source: Source, plan: Plan, layout: Layout, workers: int, tick: Callable[[int], None]
) -> Made:
    context = multiprocessing.get_context("spawn")
    ticks: Any = context.SimpleQueue()  # put blocks until written, so frames are reported before their shard is done
    count = min(workers, len(shards))
    tasks = jobs_a_process(plan.backend)
    with pool_of(count, tasks, _listen, (ticks,)) as pool:
        # submit few shards in advance, so that finished ones do not pile up in memory while earlier ones are written
        remaining, waiting = list(shards), dict[Future[bytes], Shard]()
        while remaining or waiting:
            while remaining and len(waiting) < count + 1:
                waiting[pool.submit(_make, source, plan, layout, remaining[0])] = remaining[0]
                remaining.pop(0)
            finished, _ = wait(waiting, timeout=POLL, return_when=FIRST_COMPLETED)
            _drain(ticks, tick)
            for future in finished:
                yield waiting.pop(future), future.result()


_TICKS: Any = None


def _listen(ticks: Any) -> None:
    """Keep the queue of progress reports in this worker process."""
    global _TICKS
    _TICKS = ticks


def _make(source: Source, plan: Plan, layout: Layout, shard: Shard) -> bytes:
    return shard_bytes(source, plan, layout, shard, _TICKS.put)


def _drain(ticks: Any, tick: Callable[[int], None]) -> None:
    """Pass on the progress reports that have come."""
    while not ticks.empty():
        tick(ticks.get())


def on_ray(
    shards: Sequence[Shard], source: Source, plan: Plan, layout: Layout, workers: int, tick: Callable[[int], None]
) -> Made:
    """Make shards as `local` does, but on a Ray cluster: `workers` shards at a time, each on one core.

    Raises:
        UserError: Ray is not installed, its cluster cannot be reached, or a shard kills its worker repeatedly.
    """
    for shard, data in done_on_ray(partial(shard_bytes, source, plan, layout), shards, workers, what="shard"):
        tick(shard.frames)
        yield shard, data
