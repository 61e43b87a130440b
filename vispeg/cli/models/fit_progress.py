"""How far `vispeg fit` is: a bar for each start with its present error on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from vispeg.cli.progress import SECONDS
from vispeg.identify.checkpoint import Trace


@contextmanager
def following(starts: int, steps: int, quiet: bool) -> Iterator[Callable[[int, Trace], None]]:
    """Shows the optimizers' progress while the body runs; yields a function to call at each step."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[error]}"), TimeElapsedColumn())
    log, last = not quiet and not sys.stderr.isatty(), time.monotonic()
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=quiet or log) as progress:
        bars = [progress.add_task(f"start {i + 1}", total=steps, error="") for i in range(starts)]

        def follow(i: int, trace: Trace) -> None:
            nonlocal last
            done = trace.laps + min(len(trace.generations) / 10.0, steps - 1.0)
            error = f"{trace.cost:.4g} noise variances"
            progress.update(bars[i], completed=done, error=error)
            if log and time.monotonic() - last > SECONDS:
                last = time.monotonic()
                print(f"start {i + 1} of {starts}: {done:.0f} of {steps} steps at most, {error}", file=sys.stderr)

        yield follow


@contextmanager
def generations(steps: int, quiet: bool) -> Iterator[Callable[[int, Trace], None]]:
    """Shows the generations of one CMA-ES while the body runs; yields a function to call at each."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=quiet) as progress:
        bar = progress.add_task("generations", total=steps)
        yield lambda i, trace: progress.update(
            bar, completed=len(trace.generations), description=f"cost {trace.cost:.4g} m"
        )
