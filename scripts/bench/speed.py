"""Run every benchmark of speed, one after the other, and write their tables into docs/results/speed.md.

    python scripts/bench/speed.py docs/results/speed.md [--robosuite PATH_TO_ITS_PYTHON] [--only task images]

The output of a benchmark goes between `<!-- measured: NAME -->` and `<!-- end -->`; the text around it is written by
hand. The line of `machine` states the date, the commit, the number of processors and the load of the machine.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from datetime import date
from pathlib import Path

from vispeg.core.files import write_text_atomic

HERE = Path(__file__).parent
BENCHES = {
    "rollouts": ("rollouts.py",),
    "sysid": ("sysid.py",),
    "diagnosis": ("diagnosis.py",),
    "task": ("task.py", "--rows", "16", "64"),
    "images": ("task.py", "--images", "--rows", "16"),
    "render": ("render.py",),
    "datasets": ("datasets.py",),
}
BESIDE = ("task", "images")  # those that robosuite runs beside


def filled(page: str, name: str, measured: str) -> str:
    """Return a page with a benchmark's output in its place.

    Raises:
        ValueError: the page has no such place, or several.
    """
    begin, end = f"<!-- measured: {name} -->\n", "<!-- end -->"
    if page.count(begin) != 1:
        raise ValueError(f"the page has {page.count(begin)} places for {name}, not one")
    place = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    return place.sub(lambda _: f"{begin}{measured.strip()}\n{end}", page)


def ran(name: str, robosuite: str | None) -> str:
    """Run a benchmark and return its output. Raises CalledProcessError if it fails."""
    script, *more = BENCHES[name]
    more += ["--robosuite", robosuite] if robosuite and name in BESIDE else []
    command = [sys.executable, str(HERE / script), *more]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout


def machine() -> str:
    """Return a line on the date, the commit and the machine of these measurements."""
    describe = subprocess.run(["git", "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True, check=True)
    today = date.today()
    return (
        f"{today.day} {today:%B %Y}, commit `{describe.stdout.strip()}`, {os.cpu_count()} processors, "
        f"load {os.getloadavg()[0]:.1f} before the first benchmark."
    )


def main() -> None:
    """Run them and fill the page, after each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", type=Path)
    parser.add_argument("--only", nargs="+", choices=BENCHES, default=[*BENCHES])
    parser.add_argument("--robosuite", help="a Python that has robosuite 1.5")
    given = parser.parse_args()
    page, where = given.page.read_text(encoding="utf-8"), machine()
    for name in (*given.only, "machine"):
        filled(page, name, "")  # refuses a page without the place before anything runs
    for name in given.only:
        page = filled(filled(page, name, ran(name, given.robosuite)), "machine", where)
        write_text_atomic(given.page, page, overwrite=True)
        print(name, flush=True)


if __name__ == "__main__":
    main()
