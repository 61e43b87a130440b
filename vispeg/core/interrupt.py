"""Interrupts of work that can be resumed: they carry the command that resumes it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


class Interrupted(KeyboardInterrupt):
    """An interrupt of work that can be resumed.

    Args:
        more: arguments to append to the command line to resume; empty if the same command resumes.
        instead: arguments that resume, in place of the whole command line; empty to use `more`.
    """

    def __init__(self, more: Sequence[str], instead: Sequence[str]):
        super().__init__("interrupted")
        self.more, self.instead = tuple(more), tuple(instead)

    def again(self, argv: Sequence[str]) -> list[str]:
        """Return the program's arguments that resume the work that the arguments `argv` began."""
        return [*self.instead] or [*argv, *(word for word in self.more if word not in argv)]


@contextmanager
def goes_on(*more: str, instead: Sequence[str] = ()) -> Iterator[None]:
    """Turn an interrupt of the body, or of the decorated function, into `Interrupted(more, instead)`.

    That states the command that resumes the work; without arguments it is the same command.
    """
    try:
        yield
    except Interrupted:
        raise
    except KeyboardInterrupt as stop:
        raise Interrupted(more, instead) from stop
