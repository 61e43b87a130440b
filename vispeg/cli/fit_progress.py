"""How far `vispeg fit` is: one bar with the best error so far on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from vispeg.cli.progress import SECONDS
from vispeg.diagnosis.scale import floors
from vispeg.identify.checkpoint import Trace


@contextmanager
def following(starts: int, steps: int, quiet: bool) -> Iterator[Callable[[int, Trace], None]]:
    """Show the optimizers' progress while the body runs; yield a function to call at each step.

    An optimizer may end long before its last step, so nothing is said of the time that remains.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[error]}"), TimeElapsedColumn())
    log, last = not quiet and not sys.stderr.isatty(), time.monotonic()
    done, best = [0.0] * starts, math.inf
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=quiet or log) as progress:
        title = "fitting" if starts == 1 else f"fitting, {starts} starts"
        bar = progress.add_task(title, total=starts * steps, error="")

        def follow(i: int, trace: Trace) -> None:
            nonlocal last, best
            done[i] = trace.laps + min(len(trace.generations) / 10.0, steps - 1.0)
            best = min(best, trace.cost)
            error = f"{floors(best)} x noise"
            progress.update(bar, completed=sum(done), error=error)
            if log and time.monotonic() - last > SECONDS:
                last = time.monotonic()
                print(f"start {i + 1} of {starts}: {done[i]:.0f} of {steps} steps at most, {error}", file=sys.stderr)

        yield follow


@contextmanager
def generations(steps: int, quiet: bool) -> Iterator[Callable[[int, Trace], None]]:
    """Show the generations of one CMA-ES while the body runs; yield a function to call at each."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=quiet) as progress:
        bar = progress.add_task("generations", total=steps)
        yield lambda i, trace: progress.update(
            bar, completed=len(trace.generations), description=f"cost {trace.cost:.4g} m"
        )
