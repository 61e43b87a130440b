"""A command that the user stops says with which command it goes on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


class Interrupted(KeyboardInterrupt):
    """An interrupt of work that can go on.

    Args:
        more: what is appended to the command line; nothing where the same command goes on.
        instead: the arguments that go on, in place of those that were given.
    """

    def __init__(self, more: Sequence[str] = (), instead: Sequence[str] = ()):
        super().__init__("interrupted")
        self.more, self.instead = tuple(more), tuple(instead)

    def again(self, argv: Sequence[str]) -> list[str]:
        """Give the arguments of the program with which the work that `argv` began goes on."""
        return [*self.instead] or [*argv, *(word for word in self.more if word not in argv)]


@contextmanager
def goes_on(*more: str, instead: Sequence[str] = ()) -> Iterator[None]:
    """Let what is interrupted in the body, or in the function that this decorates, go on; see `Interrupted`."""
    try:
        yield
    except Interrupted:
        raise
    except KeyboardInterrupt as stop:
        raise Interrupted(more, instead) from stop
