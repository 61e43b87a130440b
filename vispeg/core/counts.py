"""Numbers of things in words."""

from __future__ import annotations


def count(number: int, noun: str) -> str:
    """Return a number with a noun whose plural ends in s: `1 frame`, `2 frames`."""
    return f"{number} {noun}{'s' * (number != 1)}"
