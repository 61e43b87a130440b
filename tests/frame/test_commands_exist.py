"""Every command line that the documents show, run or not, has a command that exists and arguments that it takes."""

import contextlib
import io
import re
import shlex
from functools import cache
from pathlib import Path

import pytest

from vispeg.cli.main import main
from vispeg.cli.overview import COMMANDS

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
LINE = re.compile(r"^(?:    |\w+=\S+ )?vispeg (?!COMMAND)([a-z].*)$", re.MULTILINE)
WITH_SUBCOMMANDS = ("camera", "dataset", "measure", "suite")


def shown() -> set[tuple[str, str]]:
    """(page, words after `vispeg`) of every line in a block of code."""
    found = set()
    for page in PAGES:
        for text in LINE.findall(page.read_text(encoding="utf-8").replace("\\\n", " ")):
            parts = [part.strip() for part in re.split(r"&&|;|\|", f"vispeg {text}")]
            found |= {(page.name, part.removeprefix("vispeg ")) for part in parts if part.startswith("vispeg ")}
    return found


@cache
def taken(command: tuple[str, ...]) -> str:
    """What `--help` prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main([*command, "--help"]) == 0
    return out.getvalue()


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")


def test_lines_are_found():
    assert len(shown()) > 25


@pytest.mark.parametrize("command", sorted({text.split()[0] for _, text in shown()}))
def test_lines_of(command):
    assert command in COMMANDS
    for page, text in sorted(shown()):
        words = shlex.split(text, comments=True)
        if words[0] != command:
            continue
        name = tuple(words[: 2 if command in WITH_SUBCOMMANDS else 1])
        if name[-1].startswith("-"):
            name = name[:1]
        flags = [w.partition("=")[0] for w in words if re.match(r"--[a-z]", w)]
        unknown = [f for f in flags if f != "--help" and not re.search(rf"{f}(?![\w-])", taken(name))]
        assert not unknown, f"{page}: vispeg {text}: no such argument: {unknown}"
