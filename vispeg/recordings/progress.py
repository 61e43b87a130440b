"""Types of the callbacks that show how much of a recording has been read."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

Share = Callable[[float], None]  # called with the share that is read, 0 to 1
Reading = Callable[[Path], AbstractContextManager[Share]]  # shows the progress of one recording during a `with` block


def silent(path: Path) -> AbstractContextManager[Share]:
    """Show nothing while a recording is read."""
    return nullcontext(lambda share: None)
