"""Makes shards on a Ray cluster, see `vispeg.core.cluster`; every node needs the world's file at the same path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from vispeg.core.cluster import on_ray as done_on_ray
from vispeg.datasets.layout import Layout
from vispeg.datasets.shards.engine import Made
from vispeg.datasets.shards.plan import Plan, Shard
from vispeg.datasets.shards.shard import Source, shard_bytes


def on_ray(
    shards: Sequence[Shard], source: Source, plan: Plan, layout: Layout, workers: int, tick: Callable[[int], None]
) -> Made:
    """As `engine.local`: `workers` shards at a time, each on one core. A killed worker's shard is made again.

    Raises:
        UserError: Ray is not installed, its cluster cannot be reached, a shard killed its worker again and again.
    """
    for shard, data in done_on_ray(partial(shard_bytes, source, plan, layout), shards, workers, what="shard"):
        tick(shard.frames)
        yield shard, data
