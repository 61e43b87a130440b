"""How far a diagnosis is. Nobody knows how many effects it will find, so the share is an estimate that only grows."""

from __future__ import annotations

import time
from collections.abc import Callable


class Share:
    """Puts the share that is done, and the time that is left, before what is told.

    The share is of pieces of work: those behind, over those behind and those ahead. While effects are sought, one more
    of them is expected.

    Args:
        say: is told.

    Attributes:
        ahead: pieces that are expected after the present one.
    """

    def __init__(self, say: Callable[[str], None], ahead: int):
        self.say, self.ahead = say, ahead
        self.behind, self.share, self.began = 0, 0.0, time.monotonic()

    def __call__(self, text: str) -> None:
        """The next piece begins."""
        self.share = max(self.share, self.behind / (self.behind + 1 + self.ahead))
        took = time.monotonic() - self.began
        remaining = f", about {took * (1 - self.share) / self.share:.0f} s left" if self.share and took > 5 else ""
        self.behind += 1
        self.say(f"{self.share:.0%}{remaining}: {text}")
