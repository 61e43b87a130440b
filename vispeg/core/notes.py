"""Tell a user what does not stop the work: one plain line, in a command, a script and a notebook alike."""

from __future__ import annotations

import warnings

# As a module's own registry: by default the same note comes once.
_said: dict[str | tuple[str, type[Warning], int], int] = {}
_others = warnings.formatwarning


class Note(UserWarning):
    """A note; filters of the standard library's `warnings` silence it or make it an error, as any other warning."""


def note(text: str) -> None:
    """Say one line, the first time that it comes."""
    warnings.warn_explicit(text, Note, "vispeg", 0, module="vispeg", registry=_said)


def line(text: object) -> str:
    """Lay out a note as a user reads it."""
    return f"vispeg: note: {' '.join(str(text).split())}"


def _formatted(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, source: str | None = None
) -> str:
    """Show a note without a place in the source, which tells a user nothing; other warnings as they were."""
    return f"{line(message)}\n" if issubclass(category, Note) else _others(message, category, filename, lineno, source)


warnings.formatwarning = _formatted
