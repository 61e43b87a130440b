"""Intermediate results of a diagnosis on disk, so that a killed one can be resumed.

A diagnosis is deterministic, so it is simply run again. The results of its expensive steps (the score test, the end
point of each optimizer) are stored as answers to questions, and read instead of computed. Every float comes back bit
for bit, hence the same result.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from copy import copy
from pathlib import Path
from typing import Any

from vispeg.core.files import remove_unfinished, write_text_atomic
from vispeg.formats.format import Format, enrol
from vispeg.formats.guard import MB, as_written

FORMAT = "vispeg-diagnosis-progress/1"
PROGRESS = Format(FORMAT, "a diagnosis in progress", ("key", "answers"), language="json", most=256 * MB, finite=False)


class Progress:
    """Answers by question.

    Args:
        file: stores the answers, rewritten after each one; with None they are kept in memory only.
        key: everything that a diagnosis depends on; a file with another key is not used, and is replaced.

    Attributes:
        of: names of the parts, each within the one before it, that questions belong to (`part`); none for the whole.
        resumed: number of answers found in the file.
    """

    def __init__(self, file: Path | None = None, key: Any = None):
        self.file, self.key, self.answers = file, _hash(key), {}
        self.of: list[str] = []
        if file is not None and file.is_file():
            self.answers = _read(file, self.key)
        self.resumed = len(self.answers)

    def recall(self, question: Any, work_out: Callable[[], Any]) -> Any:
        """Return the stored answer to a question (both plain JSON data), else compute it by `work_out` and store it."""
        at = _hash([*self.of, question] if self.of else question)
        if at not in self.answers:
            self.answers[at] = work_out()
            self._write()
        return self.answers[at]

    def part(self, of: str) -> Progress:
        """Return a part of the progress for another diagnosis in the same run: same file, separate questions."""
        other = copy(self)
        other.of = [*self.of, of]
        return other

    def _write(self) -> None:
        if self.file is not None:
            text = json.dumps({"format": FORMAT, "key": self.key, "answers": self.answers})
            write_text_atomic(self.file, text, overwrite=True)

    def remove(self) -> None:
        """Delete the file after the diagnosis is done."""
        if self.file is not None:
            remove_unfinished(self.file)


def _hash(data: Any) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def _example(folder: Path) -> Path:
    progress = Progress(folder / "diagnosis" / "progress.json", "example")
    progress.recall("how far?", lambda: {"score": [0.5, 0.25]})
    return folder / "diagnosis" / "progress.json"


@enrol(FORMAT, _example)
def _resumed(file: Path) -> dict[str, object]:
    return Progress(file, "example").answers


def _read(file: Path, key: str) -> dict[str, object]:
    with as_written(file, "vispeg diagnose", "remove it to begin anew"):
        data = PROGRESS.read(file)
        return dict(data["answers"]) if data["key"] == key else {}
