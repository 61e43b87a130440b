"""Explain to users why another process failed: which library is missing, which package is incompletely installed."""

from __future__ import annotations

import re
import signal
import subprocess
from collections.abc import Mapping, Sequence

# the last line of a traceback, such as `ImportError: MESSAGE`
RAISED = re.compile(r"^(?:[A-Za-z_]\w*\.)*[A-Z]\w*(?:Error|Exception|Exit|Interrupt|Warning)\b:?\s*(.*)$")
LONGEST = 160  # greatest number of characters of a message
# message of an exception (pattern) -> its meaning for a user
MEANINGS = (
    (r"No module named '([\w-]+)'", r"\1 is not installed"),
    (r"No module named '([\w-]+)\.(.+)'", r"\1 is half installed: its \2 is missing"),
    (r".*?(lib[\w.+-]+\.so[\d.]*): cannot open shared object file.*", r"the library \1 is missing"),
    (r".*?([\w.+-]+\.so[\d.]*): (?:invalid ELF header|file too short).*", r"the library \1 is damaged"),
    (r".*?([\w.+-]+\.so[\d.]*): undefined symbol.*", r"the library \1 does not fit the others"),
    (r"cannot import name '(\w+)' from (?:partially initialized module )?'([\w.]+)'.*", r"\2 is half installed: no \1"),
    (r"(?:partially initialized )?module '([\w.]+)' has no attribute '(\w+)'.*", r"\1 is half installed: no \2"),
    (r"'NoneType' object has no attribute '(?:egl|gl|OSMesa)\w*'.*", "its library is missing"),
    (r".*\bEGL device display.*", "EGL finds nothing to draw on"),
    (r"\w*Error\(\s*err = (\w+).*", r"the driver says \1"),
    (r".*source code string cannot contain null bytes.*", "one of its files is damaged"),
)


def run(command: Sequence[str], env: Mapping[str, str] | None = None, timeout: float = 60.0) -> tuple[bool, str]:
    """Run a program.

    Args:
        command: the program and its arguments.
        env: its environment; None for that of this process.
        timeout: s.

    Returns:
        Whether it succeeded; and the last line that it printed or, if it failed, the reason in words.
    """
    try:
        done = subprocess.run(command, env=env, capture_output=True, text=True, errors="replace", timeout=timeout)
    except subprocess.TimeoutExpired:
        return False, f"no answer in {timeout:.0f} s"
    except OSError as error:
        return False, error.strerror or "cannot be started"
    if done.returncode == 0:
        return True, _last(done.stdout)
    if done.returncode < 0:
        return False, f"it crashes ({signal.strsignal(-done.returncode) or f'signal {-done.returncode}'})"
    return False, in_words(done.stderr) or f"ended with status {done.returncode}"


def in_words(text: str) -> str:
    """Return the meaning of the last exception in a program's output, or its last line if there is no exception."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    for i, line in reversed(list(enumerate(lines))):
        if match := RAISED.match(line):
            return meaning(" ".join([match[1], *lines[i + 1 :]]))
    return _last(text)


def meaning(message: str | BaseException) -> str:
    """Return an exception's message in words for users who do not know the code, at most `LONGEST` characters."""
    line = " ".join(str(message).split())
    for pattern, words in MEANINGS:
        if match := re.fullmatch(pattern, line):
            return match.expand(words)[:LONGEST]
    return line[:LONGEST] or "it ended without a message"


def _last(text: str) -> str:
    """Return the last line that is not empty, at most `LONGEST` characters; "" if there is none."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:LONGEST] if lines else ""
