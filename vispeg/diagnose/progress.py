"""What a diagnosis has worked out so far, on disk, so that a killed one goes on where it stood.

A diagnosis is deterministic, so it is simply run again; the answers to its dear questions (the score test, where each
optimizer ended) are read instead of computed. Every float comes back bit for bit, hence the same result.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.files import remove_unfinished, write_text_atomic

FORMAT = "vispeg-diagnosis-progress/1"


class Progress:
    """Answers by question.

    Args:
        file: where they are kept, written anew after each answer; None keeps nothing.
        key: whatever a diagnosis depends on; a file with another key is not used, and is replaced.
    """

    def __init__(self, file: Path | None = None, key: Any = None):
        self.file, self.key, self.answers = file, _hash(key), {}
        if file is not None and file.is_file():
            self.answers = _read(file, self.key)
        self.resumed = len(self.answers)

    def recall(self, question: Any, work_out: Callable[[], Any]) -> Any:
        """The answer (plain JSON data) to a question (JSON data): known, or worked out and kept."""
        at = _hash(question)
        if at not in self.answers:
            self.answers[at] = work_out()
            self._write()
        return self.answers[at]

    def _write(self) -> None:
        if self.file is not None:
            text = json.dumps({"format": FORMAT, "key": self.key, "answers": self.answers})
            write_text_atomic(self.file, text, overwrite=True)

    def remove(self) -> None:
        """The diagnosis is done: nothing is left behind."""
        if self.file is not None:
            remove_unfinished(self.file)


def _hash(data: Any) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def _read(file: Path, key: str) -> dict[str, Any]:
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        known, answers = data["key"], dict(data["answers"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError("cannot be read as a diagnosis in progress; remove it to begin anew", file=file) from error
    return answers if known == key else {}
