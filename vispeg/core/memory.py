"""Memory: how much there is to take, and what was freed goes back to the system."""

from __future__ import annotations

import ctypes
from contextlib import suppress
from pathlib import Path

MIB, GIB = 2**20, 2**30
LARGE = MIB
M_MMAP_THRESHOLD = -3  # malloc.h


def in_words(size: float) -> str:
    """Give a number of bytes for people."""
    return f"{size / GIB:.3g} GiB" if size >= GIB else f"{size / MIB:.2g} MiB"


def large_apart() -> None:
    """Give every array of LARGE bytes or more pages of its own, which go back to the system when it is freed.

    glibc does so from 128 KiB on, but raises that size to the largest that was freed, up to 32 MiB; from then on what
    large arrays leave between small ones is kept. A diagnosis of 21 effects (3 x 10 s) holds 1.1 GB this way, and 1.8
    GB without, in the same time. Nothing happens where the C library has no such call.
    """
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE)


def available(root: Path = Path("/")) -> int | None:
    """Bytes that this process may still take without swapping: of the machine, and of every control group it is in.

    Args:
        root: where /proc and /sys are.

    Returns:
        None where the system does not say (it is Linux that does).
    """
    free = []
    with suppress(OSError, ValueError, IndexError):
        lines = (root / "proc/meminfo").read_text().splitlines()
        free += [1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    with suppress(OSError):
        for line in (root / "proc/self/cgroup").read_text().splitlines():
            number, kinds, place = line.split(":", 2)
            if number == "0":
                free += _left(root / "sys/fs/cgroup", place, "memory.max", "memory.current", "inactive_file")
            elif "memory" in kinds.split(","):
                names = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
                free += _left(root / "sys/fs/cgroup/memory", place, *names)
    return min(free, default=None)


def _left(mount: Path, place: str, limit: str, used: str, cache: str) -> list[int]:
    """Return the memory left by a control group and its parents, bytes; a container sees its own group at the mount
    point.
    """
    group, left = mount / place.lstrip("/"), []
    for folder in [group, *(p for p in group.parents if p == mount or mount in p.parents)]:
        with suppress(OSError, ValueError):  # no such group seen from here, or a limit of "max"
            most, taken = int((folder / limit).read_text()), int((folder / used).read_text())
            stats = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
            left.append(max(0, most - taken + int(stats.get(cache, 0))))  # files' pages go when memory is wanted
    return left
