"""Show, check and convert rendered datasets.

Example:
    vispeg dataset show frames --out frames-page
    vispeg dataset check frames
    vispeg dataset export frames --format bop --out frames-bop
"""

from __future__ import annotations

import sys
from pathlib import Path

from vispeg.cli.command import Call, Option, command


@command("vispeg.report.dataset.build:write", "dataset", out=Option(default=None))
def show(call: Call) -> None:
    """Write a contact sheet and a page of looks, depth, labels and draws.

    Example:
        vispeg dataset show frames --out frames-page
    """
    page = call(out=call.out or Path(f"{call.dataset.resolve()}-page"))
    call.output.give({"page": str(page)}, [f"page: {page}"])


@command("vispeg.api.datasets:check_dataset", "dataset")
def check(call: Call) -> int:
    """Check a dataset for damaged or contradictory records; exit code 2 if any.

    Example:
        vispeg dataset check frames
    """
    from vispeg.cli.progress import checking

    with checking(call.output.quiet) as watch:
        checked = call(watch=watch)
    for line in checked.faults:
        print(f"vispeg: error: {line}", file=sys.stderr)
    call.output.give(checked.record, [] if checked.faults else checked.summary)
    return 2 if checked.faults else 0


@command("vispeg.datasets.formats.registry:export", "source", source=Option("dataset"), layout=Option("format"))
def export(call: Call) -> None:
    """Write a dataset in another layout.

    Example:
        vispeg dataset export frames --format bop --out frames-bop
    """
    call()
    call.output.give({"dataset": str(call.out), "format": call.layout}, [f"{call.layout}: {call.out}"])
