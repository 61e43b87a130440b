"""Notes: one-line warnings to the user, the same in a command, a script and a notebook."""

from __future__ import annotations

import warnings

# Works like the warning registry of a module: by default the same note is shown once.
_shown: dict[str | tuple[str, type[Warning], int], int] = {}
_standard_format = warnings.formatwarning


class Note(UserWarning):
    """A note. Filters of the standard library's `warnings` can silence it or make it an error."""


def note(text: str) -> None:
    """Show a note to the user, unless the same one has been shown before."""
    warnings.warn_explicit(text, Note, "vispeg", 0, module="vispeg", registry=_shown)


def line(text: object) -> str:
    """Return a note as the user sees it."""
    return f"vispeg: note: {' '.join(str(text).split())}"


def _formatted(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, source: str | None = None
) -> str:
    """Format a note without its place in the source code, which does not help a user; other warnings as usual."""
    if issubclass(category, Note):
        return f"{line(message)}\n"
    return _standard_format(message, category, filename, lineno, source)


warnings.formatwarning = _formatted
