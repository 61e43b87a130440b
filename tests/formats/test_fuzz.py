"""Every format that the program reads, damaged in thousands of ways: read, or refused in one line. Never a traceback,
never a hang, never a file.

The formats are those that enrolled where their readers are defined (`vispeg.formats.format.enrol`), so that a new one
is tested by being there.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import random
import shutil
import signal
import warnings
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import vispeg
from tests.formats.mutate import damage
from vispeg.core.errors import UserError
from vispeg.formats.format import DECLARED, ENROLLED

INPUTS = int(os.environ.get("VISPEG_FUZZ_INPUTS", "2400"))  # in all
SLOW = 16  # times fewer inputs for a slow reader
LONGEST = 5.0  # s of this process; a reader that waits for ever meets the time limit of tests

for _module in pkgutil.walk_packages(vispeg.__path__, "vispeg."):
    if not _module.name.endswith(("__main__", "task.lerobot")):  # the latter is imported by LeRobot alone
        importlib.import_module(_module.name)
NAMES = sorted(ENROLLED)


def files(folder: Path) -> dict[str, bytes]:
    """Name and content of every file."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def pristine(tmp_path_factory):
    """The folder of a format's example, and what in it the reader takes."""
    made: dict[str, tuple[Path, str]] = {}

    def example(name: str) -> tuple[Path, str]:
        if name not in made:
            folder = tmp_path_factory.mktemp("example")
            made[name] = folder, str(ENROLLED[name].example(folder).relative_to(folder))
        return made[name]

    return example


def test_every_format_that_is_declared_is_read_by_a_reader_that_enrolled():
    assert {one.name for one in DECLARED} <= set(NAMES)
    assert len(NAMES) >= 15


@pytest.mark.parametrize("name", NAMES)
def test_the_example_is_read(name, pristine, tmp_path, monkeypatch):
    folder, path = pristine(name)
    monkeypatch.chdir(tmp_path)
    before = files(folder)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ENROLLED[name].read(folder / path)
    assert files(folder) == before and not os.listdir(tmp_path)


class StillReading(BaseException):
    """Of no kind that a reader may catch."""


def too_long(*_):
    raise StillReading


@pytest.mark.parametrize("name", NAMES)
def test_what_is_damaged_is_read_or_refused_in_one_line(name, pristine, tmp_path, monkeypatch):
    source, path = pristine(name)
    stand = tmp_path / "stand"
    stand.mkdir()
    monkeypatch.chdir(stand)
    parts = sorted(p.relative_to(source) for p in source.rglob("*") if p.is_file())

    share = 1 + INPUTS // sum(1 if one.slow else SLOW for one in ENROLLED.values())

    @settings(max_examples=share if ENROLLED[name].slow else share * SLOW, suppress_health_check=list(HealthCheck))
    @given(seed=st.integers(0, 2**32))
    def check(seed):
        rng = random.Random(f"{name} {seed}")
        folder = tmp_path / "case"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(source, folder)
        damage(folder / rng.choice(parts), rng)
        before = sorted(p.relative_to(folder) for p in folder.rglob("*"))
        signal.setitimer(signal.ITIMER_PROF, LONGEST)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                ENROLLED[name].read(folder / path)
        except UserError as error:
            text = str(error)
            assert "\n" not in text and text.isprintable() and len(text) < 2000, text
            text.encode()
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        assert sorted(p.relative_to(folder) for p in folder.rglob("*")) == before and not os.listdir(stand)

    handler = signal.signal(signal.SIGPROF, too_long)
    try:
        check()
    finally:
        signal.signal(signal.SIGPROF, handler)
