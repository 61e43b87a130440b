"""What the documents show runs: every block below a `<!-- test -->` line is executed as it stands."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^<!-- test -->\n```(bash|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
BLOCKS = [(page, *match) for page in PAGES for match in BLOCK.findall(page.read_text(encoding="utf-8"))]


def test_every_marked_block_is_found():
    marks = sum(page.read_text(encoding="utf-8").count("<!-- test -->\n") for page in PAGES)
    assert len(BLOCKS) == marks >= 4


@pytest.mark.parametrize(
    ("page", "language", "text"), BLOCKS, ids=[f"{page.stem}-{i}" for i, (page, *_) in enumerate(BLOCKS)]
)
def test_block_runs(page, language, text, tmp_path):
    tools = tmp_path / "bin"
    tools.mkdir()
    (tools / "vispeg").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m vispeg "$@"\n')
    (tools / "vispeg").chmod(0o755)
    (tools / "python").symlink_to(sys.executable)
    path = f"{tools}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
    command = ["bash", "-euo", "pipefail", "-c", text] if language == "bash" else [sys.executable, "-c", text]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout + done.stderr
    for expected in re.findall(r"^print\(.*\)  # (.+)$", text, re.MULTILINE):  # `print(x)  # what it prints`
        assert expected in done.stdout.splitlines()


def test_pages_that_the_code_cites_are_there():
    cited = re.compile(r"(?<![\w/])(?:docs/[\w/-]+|[A-Z][A-Z0-9_]+)\.md\b")
    files = [*ROOT.glob("vispeg/**/*.py"), *ROOT.glob("scripts/**/*.py")]
    names = {(file.name, name) for file in files for name in cited.findall(file.read_text(encoding="utf-8"))}
    missing = {(file, name) for file, name in names if not (ROOT / name).is_file()}
    assert names and {name for _, name in missing} <= {"ORDER.md"}, missing  # which `measure plan` writes


def test_tests_that_the_documents_name_are_there():
    named = {(page.name, path) for page in PAGES for path in re.findall(r"`(tests/[\w/.]+)`", page.read_text("utf-8"))}
    assert named and not [(page, path) for page, path in named if not (ROOT / path).exists()]


def prose(page: Path) -> str:
    """The page without its blocks of code."""
    return re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    """What its headings are called in a link, as the site and GitHub make it."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    words = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading) for heading in headings]
    return {re.sub(r"\s+", "-", re.sub(r"[^\w\s-]", "", text).strip().lower()) for text in words}


def test_links_between_pages_lead_to_a_page_and_its_heading():
    for page in PAGES:
        for link, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)", prose(page)):
            if link.startswith(("http:", "https:", "mailto:")):
                continue
            target = page.parent / link if link else page
            assert target.exists(), f"{page.name}: {link}"
            assert not anchor or anchor in anchors(target), f"{page.name}: {link}#{anchor}"
