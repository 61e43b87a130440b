"""How far long work is, on standard error: bars on a terminal; elsewhere a line now and then, for a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vispeg.evaluation.jobs import Job
    from vispeg.evaluation.records import Episode

SHARE, SECONDS = 0.1, 10.0  # a line in a log is this much further than the last one, and so much later
MOST = 12  # rows of a terminal


@contextmanager
def bars(totals: Mapping[str, int], unit: str, quiet: bool = False) -> Iterator[Callable[..., None]]:
    """Bars by name, and one of all where there are several; yields `advance(name, by, note="", resumed=False)`.

    Args:
        totals: name -> how many there will be.
        unit: of what is counted, such as frames.
        quiet: show nothing.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    terminal = sys.stderr.isatty()
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), disable=quiet or not terminal) as display:
        several = len(totals) > 1
        rows = {n: display.add_task(n, total=t, note="") for n, t in [*totals.items()][:MOST]}
        overall = display.add_task(f"all {unit}", total=sum(totals.values()), note="") if several else None
        log = _Log(totals, unit, quiet or terminal)

        def advance(name: str, by: int, note: str = "", resumed: bool = False) -> None:
            if name in rows:
                display.update(rows[name], advance=by, note=note if overall is None else "")
            if overall is not None:
                display.update(overall, advance=by, note=note)
            log.advance(name, by, note, resumed)

        yield advance


@contextmanager
def rendering(frames: int, quiet: bool = False) -> Iterator[tuple[Callable[[int, int], None], Callable[[int], None]]]:
    """A bar of frames with the rate of the new ones; yields a function of earlier and new frames."""
    began = time.monotonic()
    made = 0
    with bars({"rendering": frames}, "frames", quiet) as advance:

        def watch(drawn: int) -> None:
            nonlocal made
            made += drawn
            advance("rendering", drawn, f"{made / max(time.monotonic() - began, 1e-9):.1f} frames/s")

        yield lambda total, resumed: advance("rendering", resumed, resumed=True), watch


@contextmanager
def checking(quiet: bool = False) -> Iterator[Callable[[int, int], None]]:
    """Show a bar of frames that are checked; yields `watch(frames, total)`, whose first call tells the total."""
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
    """A bar of episodes for each policy, with the success so far; yields a function of episodes as they end."""
    from vispeg.evaluation.records import read
    from vispeg.evaluation.runner import EPISODES

    totals: dict[str, int] = {}
    for job in jobs:
        totals[job.entrant.name] = totals.get(job.entrant.name, 0) + len(job.seeds)
    before = {e.key for e in read(folder / EPISODES)} if (folder / EPISODES).exists() else set()
    wins = [0, 0]
    with bars(totals, "episodes", quiet) as advance:
        for job in jobs:
            advance(job.entrant.name, sum(key in before for key in job.keys()), resumed=True)

        def watch(new: Sequence[Episode], *_: int) -> None:
            wins[0], wins[1] = wins[0] + sum(e.success for e in new), wins[1] + len(new)
            if new:
                rate = f"{100 * wins[0] / wins[1]:.0f} % of the new ones succeed"
                advance(new[0].policy, len(new), f"{rate}, now {new[0].policy} in {new[0].world}")

        yield watch


class _Log:
    """Lines in place of bars."""

    def __init__(self, totals: Mapping[str, int], unit: str, quiet: bool):
        self.totals, self.unit, self.quiet = totals, unit, quiet
        self.done = dict.fromkeys(totals, 0)
        self.resumed, self.share = 0, 0.0
        self.began = self.last = time.monotonic()

    def advance(self, name: str, by: int, note: str, resumed: bool) -> None:
        """`resumed`: what was done before."""
        self.done[name] += by
        self.resumed += by if resumed else 0
        done, total, now = sum(self.done.values()), sum(self.totals.values()), time.monotonic()
        share = done / max(total, 1)
        if self.quiet or resumed or done >= total or share - self.share < SHARE or now - self.last < SECONDS:
            return
        self.share, self.last = share, now
        seconds = (now - self.began) * (total - done) / max(done - self.resumed, 1)
        each = ", ".join(f"{n} {d} of {self.totals[n]}" for n, d in self.done.items() if len(self.done) > 1)
        words = (f"{done} of {total} {self.unit} ({share:.0%})", note, each, f"about {duration(seconds)} left")
        print("; ".join(filter(None, words)), file=sys.stderr, flush=True)


@contextmanager
def stages(quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """A line that changes on a terminal, lines elsewhere; yields what tells the present stage."""
    from rich.console import Console

    if quiet:
        yield lambda text: None
    elif sys.stderr.isatty():
        with Console(stderr=True).status("") as status:
            yield lambda text: status.update(text)
    else:
        yield lambda text: print(text, file=sys.stderr, flush=True)


def duration(seconds: float) -> str:
    """`40 s`, `12 min`, `3.5 h`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
