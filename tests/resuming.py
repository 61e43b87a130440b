"""Stop a diagnosis and resume it: its result has the same bytes as that of an uninterrupted one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import vispeg


class Killed(Exception):
    """Raised in place of a signal that ends the process."""


def resumed(model: Path, recordings: tuple[Path, Path], folder: Path, when: str, **options) -> None:
    """Stop a diagnosis at its message `when`, resume it, and compare the result with an uninterrupted one."""
    said: list[str] = []

    def kill(text: str) -> None:
        said.append(text)
        if when in text:
            raise Killed

    def run(name: str, part: str, say=said.append) -> bytes:
        found = vispeg.diagnose(model, *recordings, part=folder / part, say=say, threads=1, **options)
        found.save(folder / name)
        record = json.loads((folder / name / "diagnosis.json").read_text())
        record.pop("provenance")
        return json.dumps(record).encode() + (folder / name / "model.yaml").read_bytes()

    with pytest.raises(Killed):
        run("killed", "part", kill)
    known = set(json.loads((folder / "part" / "progress.json").read_text())["answers"])
    assert known and said[0] == "simulating"
    said.clear()
    again = run("again", "part")
    assert said[0] == "going on"
    assert not (folder / "part" / "progress.json").exists()
    assert again == run("whole", "other"), "the same bytes"
