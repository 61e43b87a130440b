"""Show progress on standard error: a bar on a terminal, else occasional lines for a log."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vispeg.evaluation.jobs import Job
    from vispeg.evaluation.records import Episode
    from vispeg.identify.checkpoint import Trace

SHARE, SECONDS = 0.1, 10.0  # least progress and least time, s, between two lines in a log
SURE = 5.0  # s of work after which the remaining time is estimated
LARGE = 50_000_000  # bytes; reading a larger file is worth a line


class Pace:
    """Estimate the remaining time from the time that each kind of work took so far.

    Policies differ a hundredfold in the time of an episode, so each has its own pace. There is no estimate until every
    kind has begun, or after nothing has arrived for as long as all remaining work should take.

    Args:
        totals: name -> total count.
    """

    def __init__(self, totals: Mapping[str, int]):
        self.totals = dict(totals)
        self.done = dict.fromkeys(totals, 0)
        self.new = dict.fromkeys(totals, 0)  # counts of this run
        self.took = dict.fromkeys(totals, 0.0)  # s
        self.last = time.monotonic()

    def advance(self, name: str, by: int, resumed: bool = False) -> None:
        """Add `by` to the count of a name; with `resumed`, as work of an earlier run, which took no time now."""
        self.done[name] += by
        if not resumed:
            now = time.monotonic()
            self.new[name] += by
            self.took[name] += now - self.last
            self.last = now

    def left(self) -> float | None:
        """Return the remaining time, s; None if unknown."""
        waiting = [n for n, total in self.totals.items() if self.done[n] < total]
        if any(not self.new[n] for n in waiting) or sum(self.took.values()) < SURE:
            return None
        seconds = sum((self.totals[n] - self.done[n]) * self.took[n] / self.new[n] for n in waiting)
        seconds -= time.monotonic() - self.last
        return seconds if seconds > 0 else None


@contextmanager
def bars(totals: Mapping[str, int], unit: str, quiet: bool = False) -> Iterator[Callable[..., None]]:
    """Show one bar for all names together; yield `advance(name, by, note="", resumed=False)`.

    Args:
        totals: name -> total count.
        unit: what is counted, such as frames.
        quiet: show nothing.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn
    from rich.table import Column
    from rich.text import Text

    class Left(ProgressColumn):
        """The remaining time, updated even while nothing arrives."""

        def render(self, task: object) -> Text:
            return Text(_left(pace))

    terminal, pace = sys.stderr.isatty(), Pace(totals)
    columns = (
        TextColumn("{task.description}", table_column=Column(no_wrap=True)),
        BarColumn(),
        MofNCompleteColumn(),
        Left(table_column=Column(no_wrap=True)),
        TextColumn("{task.fields[note]}", table_column=Column(no_wrap=True, overflow="ellipsis", ratio=1)),
    )
    with Progress(*columns, console=Console(stderr=True), disable=quiet or not terminal, expand=True) as display:
        title = unit if len(totals) > 1 else next(iter(totals), unit)
        row = display.add_task(title, total=sum(totals.values()), note="")
        log = _Log(pace, unit, quiet or terminal)

        def advance(name: str, by: int, note: str = "", resumed: bool = False) -> None:
            pace.advance(name, by, resumed)
            display.update(row, advance=by, note=note)
            log.update(note, resumed)

        yield advance


@contextmanager
def rendering(frames: int, quiet: bool = False) -> Iterator[tuple[Callable[[int, int], None], Callable[[int], None]]]:
    """Show a bar of frames with the present rate.

    Yields `begun(total, resumed)`, which counts frames of an earlier run, and `watch(drawn)`, which counts new frames.
    """
    began = time.monotonic()
    made = 0
    with bars({"rendering": frames}, "frames", quiet) as advance:

        def watch(drawn: int) -> None:
            nonlocal made
            made += drawn
            advance("rendering", drawn, f"{made / max(time.monotonic() - began, 1e-9):.1f} frames/s")

        yield lambda total, resumed: advance("rendering", resumed, resumed=True), watch


@contextmanager
def checking(quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """Show a bar of checked frames; yield `watch(frames, total)`, whose first call sets the total."""
    with ExitStack() as stack:
        advance: list[Callable[..., None]] = []

        def watch(frames: int, total: int) -> None:
            if not advance:
                advance.append(stack.enter_context(bars({"checking": total}, "frames", quiet)))
            advance[0]("checking", frames)

        yield watch


@contextmanager
def playing(
    jobs: Sequence[Job], folder: Path, quiet: bool = False
) -> Iterator[Callable[[Sequence[Episode], int, int], None]]:
    """Show a bar of all episodes, with the success so far; yield a function to call with episodes as they end."""
    from vispeg.evaluation.folder import EPISODES
    from vispeg.evaluation.records import read

    totals: dict[str, int] = {}
    for job in jobs:
        totals[job.entrant.name] = totals.get(job.entrant.name, 0) + len(job.seeds)
    before = {e.key for e in read(folder / EPISODES)} if (folder / EPISODES).exists() else set()
    successes = played = 0  # of this run
    with bars(totals, "episodes", quiet) as advance:
        for job in jobs:
            advance(job.entrant.name, sum(key in before for key in job.keys()), resumed=True)

        def watch(new: Sequence[Episode], *_: int) -> None:
            nonlocal successes, played
            successes, played = successes + sum(e.success for e in new), played + len(new)
            if new:
                rate = f"{100 * successes / played:.0f} % of the new ones succeed"
                advance(new[0].policy, len(new), f"{rate}, now {new[0].policy} in {new[0].world}")

        yield watch


class _Log:
    """Print lines in place of a bar."""

    def __init__(self, pace: Pace, unit: str, quiet: bool):
        self.pace, self.unit, self.quiet = pace, unit, quiet
        self.share, self.last = 0.0, time.monotonic()

    def update(self, note: str, resumed: bool) -> None:
        """Print the progress if it is far enough beyond the last line."""
        done, totals, now = self.pace.done, self.pace.totals, time.monotonic()
        count, total = sum(done.values()), sum(totals.values())
        share = count / max(total, 1)
        if self.quiet or resumed or count >= total or share - self.share < SHARE or now - self.last < SECONDS:
            return
        self.share, self.last = share, now
        each = ", ".join(f"{n} {d} of {totals[n]}" for n, d in done.items() if len(done) > 1)
        words = (f"{count} of {total} {self.unit} ({share:.0%})", note, each, _left(self.pace))
        print("; ".join(filter(None, words)), file=sys.stderr, flush=True)


def _left(pace: Pace) -> str:
    """Return the remaining time as `about 12 min left`; empty if unknown."""
    seconds = pace.left()
    return "" if seconds is None else f"about {duration(seconds)} left"


@dataclass(frozen=True)
class Stages:
    """Functions that show text: `tell` shows the present stage, `keep` prints text that stays on the screen."""

    tell: Callable[[str], object]
    keep: Callable[[str], object]

    def __call__(self, text: str) -> None:
        """Show the present stage."""
        self.tell(text)


@contextmanager
def stages(quiet: bool = False) -> Iterator[Stages]:
    """Show the present stage: on a terminal in one changing line with the elapsed time, else in a line per stage.

    The number of stages is unknown, so there is no remaining time. Yields the functions that show a stage.
    """
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
    from rich.table import Column

    if quiet:
        yield Stages(lambda text: None, lambda text: None)
    elif sys.stderr.isatty():
        whole, rest = Column(no_wrap=True), Column(no_wrap=True, overflow="ellipsis", ratio=1)
        stage = TextColumn("{task.description}", markup=False, table_column=rest)
        columns = (SpinnerColumn(table_column=whole), TimeElapsedColumn(table_column=whole.copy()), stage)
        with Progress(*columns, console=Console(stderr=True), transient=True, expand=True) as display:
            row = display.add_task("", total=None)
            keep = partial(display.console.print, markup=False, highlight=False)
            yield Stages(lambda text: display.update(row, description=text), keep)
    else:
        write = partial(print, file=sys.stderr, flush=True)
        yield Stages(write, write)


def duration(seconds: float) -> str:
    """Return a duration, s, as text: `40 s`, `12 min`, `3.5 h`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


@contextmanager
def following(starts: int, steps: int, quiet: bool) -> Iterator[Callable[[int, Trace], None]]:
    """Show the optimizers' progress while the body runs; yield a function to call at each step.

    An optimizer may end long before its last step, so no remaining time is shown.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from vispeg.diagnosis.scale import floors

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
    """Show the generations of a CMA-ES while the body runs; yield a function to call at each."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=quiet) as progress:
        bar = progress.add_task("generations", total=steps)
        yield lambda i, trace: progress.update(
            bar, completed=len(trace.generations), description=f"cost {trace.cost:.4g} m"
        )


@contextmanager
def progress_bar(title: str, size: int = 0, quiet: bool = False) -> Iterator[Callable[[float], None]]:
    """Show progress on standard error while the body runs; yield a function of the share, 0 to 1.

    Args:
        title: the work, such as `reading rig-a`.
        size: bytes to read; if standard error is no terminal, a large size gets one line.
        quiet: show nothing.
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


def reading_bars(quiet: bool) -> Callable[[Path], AbstractContextManager[Callable[[float], None]]]:
    """Return a progress display for functions that read several recordings."""
    return lambda path: progress_bar(f"reading {path}", size_of(path), quiet)


def size_of(recording: Path) -> int:
    """Return the size of a recording's samples in bytes; 0 if there are none."""
    from vispeg.recordings.load import SAMPLES

    return sum((recording / name).stat().st_size for name in SAMPLES if (recording / name).is_file())
