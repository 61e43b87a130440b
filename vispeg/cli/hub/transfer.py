"""Bars of bytes that come or go and of frames that are checked, whose number is known once each begins."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

KB = 1000


@contextmanager
def transfer(quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """Yields `watch(name, by, total)`; one bar at a time, and bytes are shown in kB."""
    from vispeg.cli.progress import bars

    advances: dict[str, Callable[..., None]] = {}
    done: Counter[str] = Counter()
    with ExitStack() as stack:

        def watch(name: str, by: int, total: int) -> None:
            unit = KB if name.endswith("kB") else 1
            if name not in advances:
                stack.close()
                advances[name] = stack.enter_context(bars({name: total // unit}, name.split()[-1], quiet))
            before = done[name]
            done[name] += by
            advances[name](name, done[name] // unit - before // unit)

        yield watch
