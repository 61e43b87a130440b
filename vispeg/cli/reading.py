"""Reads recordings with a word on how far it is: bars on a terminal, one line for a large file elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

LARGE = 50_000_000  # bytes that take long enough for a line


@contextmanager
def progress_bar(title: str, size: int = 0, quiet: bool = False) -> Iterator[Callable[[float], None]]:
    """Show progress on standard error while the body runs; yield a function of the share, 0 to 1.

    Args:
        title: what goes on, such as `reading rig-a`.
        size: bytes that are read; where standard error is no terminal, large ones get one line.
        quiet: nothing is shown.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    terminal = sys.stderr.isatty()
    if size > LARGE and not terminal and not quiet:
        print(f"{title}, {size / 1e6:.0f} MB", file=sys.stderr, flush=True)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=quiet or not terminal) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def reading_bars(quiet: bool = False) -> Callable[[Path], AbstractContextManager[Callable[[float], None]]]:
    """Give what shows how far a recording is read, for the functions that read several."""
    return lambda path: progress_bar(f"reading {path}", size_of(path), quiet)


def size_of(recording: Path) -> int:
    """Bytes of a recording's samples; 0 where there are none."""
    from vispeg.recordings.load import SAMPLES

    return sum((recording / name).stat().st_size for name in SAMPLES if (recording / name).is_file())
