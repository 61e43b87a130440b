"""The progress bars of `vispeg fit`: one for each start, with its present error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from vispeg.identify.checkpoint import Trace


@contextmanager
def following(starts: int, steps: int, quiet: bool) -> Iterator[Callable[[int, Trace], None]]:
    """Bars on standard error while the body runs; yields what an optimizer's step is told to."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[error]}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=quiet) as progress:
        bars = [progress.add_task(f"start {i + 1}", total=steps, error="") for i in range(starts)]

        def told(i: int, trace: Trace) -> None:
            generations = len(trace.generations) / 10.0
            error = f"{trace.cost:.4g} noise variances"
            progress.update(bars[i], completed=trace.laps + min(generations, steps - 1.0), error=error)

        yield told
