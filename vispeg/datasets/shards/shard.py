"""Make a shard as a Parquet file with one row group per episode.

Its episode and frame indices count from 0; `vispeg.datasets.lerobot.place` adds the numbers of those before the shard.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import TYPE_CHECKING

import numpy as np

from vispeg.datasets.episode import Episode
from vispeg.datasets.layout import Layout, column, packing, schema
from vispeg.datasets.shards.plan import Plan, Shard
from vispeg.datasets.stats import Stats, of_numbers

if TYPE_CHECKING:
    import pyarrow as pa

# Makes the episodes of a shard. It is sent to workers by name, so it must be a top-level function of a module.
Source = Callable[[Plan, Layout, Shard], Iterator[Episode]]
Tick = Callable[[int], None]
ABOUT = b"vispeg.episodes"
_TICK: ContextVar[Tick] = ContextVar("tick", default=lambda frames: None)


def shard_bytes(source: Source, plan: Plan, layout: Layout, shard: Shard, tick: Tick = lambda frames: None) -> bytes:
    """Make a shard; return its bytes, which are the same wherever and whenever it is made.

    Args:
        source: the function that makes its episodes.
        plan, layout, shard: content and format of the dataset, and the shard to make.
        tick: called with the number of new frames, whenever the source reports them (see `drawn`) or ends an episode.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink, about, first, reported = pa.BufferOutputStream(), [], 0, 0

    def tell(frames: int) -> None:
        nonlocal reported
        reported += frames
        tick(frames)

    _TICK.set(tell)
    with pq.ParquetWriter(sink, schema(layout.all), **packing(layout.all)) as file:
        for number, episode in enumerate(source(plan, layout, shard)):
            table, stats = counted(layout, episode, number, first)
            file.write_table(table)
            about.append({"length": len(episode), "stats": {**episode.stats, **stats}, "about": dict(episode.about)})
            first += len(episode)
            if first > reported:
                tell(first - reported)
        if first != shard.frames:
            raise ValueError(f"shard {shard.number} has {first} frames, not {shard.frames}")
        file.add_key_value_metadata({ABOUT.decode(): json.dumps(about)})
    return sink.getvalue().to_pybytes()


def drawn(frames: int) -> None:
    """Report new frames from within a source, before their episode is complete."""
    _TICK.get()(frames)


def counted(layout: Layout, episode: Episode, number: int, first: int) -> tuple[pa.Table, dict[str, Stats]]:
    """Return an episode's table including counters, and the statistics of the counters.

    Args:
        layout: layout of the dataset.
        episode: the episode.
        number: index of the episode.
        first: index of its first frame.
    """
    import pyarrow as pa

    n = len(episode)
    frame = np.arange(n)
    counters = {
        "timestamp": (frame / layout.fps).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(n, number),
        "index": first + frame,
        "task_index": np.zeros(n, np.int64),
    }
    values = {**episode.values, **counters}
    columns = [column(feature, values[name]) for name, feature in layout.all.items()]
    return pa.table(columns, schema=schema(layout.all)), {name: of_numbers(v) for name, v in counters.items()}
