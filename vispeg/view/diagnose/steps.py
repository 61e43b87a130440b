"""What was done by hand in a folder of progress, so that a killed page goes on from there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypedDict

from vispeg.core.files import write_text_atomic

STEPS = "steps.json"  # in the folder of the progress


class Done(TypedDict):
    """The key of the search that a folder belongs to, and its steps."""

    key: str
    steps: list[list[str]]


def read_steps(part: Path) -> Done:
    """Give what a folder says of its search; empty where it is nobody's."""
    try:
        data = json.loads((part / STEPS).read_text(encoding="utf-8"))
        return {"key": str(data["key"]), "steps": [[str(word) for word in step] for step in data["steps"]]}
    except (OSError, ValueError, TypeError, KeyError):
        return {"key": "x" if part.exists() else "", "steps": []}


def write_steps(part: Path, key: str, steps: list[list[str]]) -> None:
    """Write it down, over what was there."""
    write_text_atomic(part / STEPS, json.dumps(Done(key=key, steps=steps)) + "\n", overwrite=True)
