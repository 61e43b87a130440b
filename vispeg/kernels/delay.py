"""Delays of signals, each with its own lag."""

from __future__ import annotations

from vispeg.kernels.compiled import ROWS, VECTOR, WHOLE, compiled, to


@compiled(ROWS, WHOLE, VECTOR, to(VECTOR))
def delayed(past, head, lag, out):
    """Write the values (k,) of `lag` (k,) steps ago from a ring buffer `past` (size, k) whose newest row is `head`.

    Lags must be from 0 to size - 2 steps; between two steps the value is interpolated linearly.

    Raises:
        ValueError: the lengths of `lag`, `out` and the rows of `past` differ.
    """
    size = len(past)
    if past.shape[1] != len(out) or len(lag) != len(out):
        raise ValueError("each value needs its lag and its column of the ring buffer")
    for k in range(len(out)):
        steps = min(int(lag[k]), size - 2)
        part = lag[k] - steps
        near = past[(head - steps) % size, k]
        out[k] = near + part * (past[(head - steps - 1) % size, k] - near) if part > 0 else near
