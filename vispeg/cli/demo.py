"""`vispeg demo`: compare and diagnose a model with bundled recordings."""

from __future__ import annotations

import time
from pathlib import Path

from vispeg.cli.command import Call, command


@command("vispeg.api.demo:demo")
def demo(call: Call, out: Path = Path("vispeg-demo"), overwrite: bool = False) -> None:
    """Run the main job on bundled recordings, in about three minutes.

    Compares the nominal model with recordings of a simulated robot, names the effects that it hides, and writes a
    report. Then renders a contact sheet of the randomized task as its cameras see it.

    Example:
        vispeg demo
        vispeg demo --out demo --overwrite

    Args:
        out: folder for the results.
        overwrite: replace `out` if it exists.
    """
    from rich.console import Console

    from vispeg.api.demo import FITTED, HELD_OUT, Demonstration
    from vispeg.core.files import reserved
    from vispeg.report.record import ROBOT, SHEET

    start = time.monotonic()
    console = Console(stderr=True, highlight=False, quiet=call.output.quiet)
    with reserved(out, overwrite, holds=Demonstration.holds), console.status("reading") as status:
        console.print(f"fitted: {', '.join(FITTED)}; held out: {', '.join(HELD_OUT)}")
        result = call(say=status.update)
        result.save(out, overwrite=overwrite)
    if result.problem:
        console.print(f"no pictures of the cell: {result.problem}")
    pictures = (("the robot and its cell", ROBOT), ("what policies are trained on", SHEET))
    files = [f"{what}: {out / name}" for what, name in pictures if name in result.pictures]
    call.give(result, *files, f"report: {out / 'report.html'}  ({time.monotonic() - start:.0f} s)")
